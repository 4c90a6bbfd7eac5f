"""Curves in logarithmic axes as an SVG picture, with Python's standard library alone."""

import html
import math

WIDTH, HEIGHT = 460, 340  # Of one panel [px].
LEFT, RIGHT, TOP, BOTTOM = 58, 30, 36, 46
COLORS = ["#1f77b4", "#d95f02", "#2ca02c", "#7b3294"]
STEPS = (1, 2, 5)


def _ticks(low, high):
    """1, 2, 5 times powers of ten from at most `low` to at least `high`."""
    values = [step * 10.0 ** power for power in range(math.floor(math.log10(low)) - 1,
                                                     math.ceil(math.log10(high)) + 1)
              for step in STEPS]
    first = max(i for i, value in enumerate(values) if value <= low * (1 + 1e-9))
    last = min(i for i, value in enumerate(values) if value >= high * (1 - 1e-9))
    return values[first:max(last, first + 1) + 1]


def _text(x, y, text, anchor="middle", extra=""):
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{extra}>{html.escape(text)}</text>'


def _panel(x0, title, x_label, curves):
    """`curves` has a list of (x, y) by name, all above zero."""
    values = [point for curve in curves.values() for point in curve]
    axes = [_ticks(min(v[k] for v in values), max(v[k] for v in values)) for k in (0, 1)]
    sizes = (WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM)

    def place(point):
        x, y = (math.log(v / a[0]) / math.log(a[-1] / a[0]) * s
                for v, a, s in zip(point, axes, sizes))
        return x0 + LEFT + x, TOP + sizes[1] - y

    parts = [_text(x0 + LEFT + sizes[0] / 2, 20, title, extra=' font-size="14"'),
             _text(x0 + LEFT + sizes[0] / 2, HEIGHT - 10, x_label)]
    for x in axes[0]:
        left, bottom = place((x, axes[1][0]))
        parts.append(f'<path class="grid" d="M{left:.1f} {bottom:.1f}V{TOP}"/>')
        parts.append(_text(left, bottom + 16, f"{x:,.15g}"))
    for y in axes[1]:
        left, bottom = place((axes[0][0], y))
        parts.append(f'<path class="grid" d="M{left:.1f} {bottom:.1f}h{sizes[0]}"/>')
        parts.append(_text(left - 6, bottom + 4, f"{y:,.15g}", "end"))
    for i, (name, curve) in enumerate(curves.items()):
        color = COLORS[i % len(COLORS)]
        places = [place(point) for point in sorted(curve)]
        line = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
        parts.append(f'<polyline points="{line}" fill="none" stroke="{color}" stroke-width="2"/>')
        parts += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{color}"/>' for x, y in places]
        parts.append(_text(x0 + LEFT + 10, TOP + 18 + 17 * i, name, "start", f' fill="{color}"'))
    return "\n".join(parts)


def write(path, x_label, panels):
    """Panels side by side; `panels` has the curves by title."""
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH * len(panels)}" '
             f'height="{HEIGHT}" font-family="sans-serif" font-size="11" fill="#222">',
             "<style>.grid { stroke: #e2e2e2; }</style>",
             '<rect width="100%" height="100%" fill="#fff"/>']
    parts += [_panel(k * WIDTH, title, x_label, curves)
              for k, (title, curves) in enumerate(panels.items())]
    path.write_text("\n".join([*parts, "</svg>"]) + "\n")
