#!/usr/bin/env python3
"""Opens a report of the test chain in a headless Chromium: it loads nothing and without a word on
the console, its switches do what they say, and points and planes tell of themselves.

usage: report_browser_test.py S3_REPORT CHAIN_DIR
Ends with 77 (skipped) where no Chromium is installed.
"""

import base64
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

import devtools

SKIPPED = 77


def make_report(program, chain, folder, *more):
    folder.mkdir(exist_ok=True)
    run = folder / "run"
    run.mkdir()
    for name, target in (("1_slam", "1_slam"), ("2_lift", "2_lift_noisy"),
                         ("3_refine", "3_refine_noisy"), ("3_refine_plain", "3_refine_plain")):
        (run / name).symlink_to(chain / target)
    page = folder / "report.html"
    subprocess.run([program, "--run", run, "--output", page, "--quiet", *more], check=True,
                   stdout=subprocess.DEVNULL)
    return page


class Untold(unittest.TestCase):
    """A run of which neither the truth nor the trust in its frames is known."""

    program = chain = None

    def test_shows_the_rest(self):
        with tempfile.TemporaryDirectory() as folder:
            run_of_old = pathlib.Path(folder) / "old"
            shutil.copytree(self.chain / "1_slam", run_of_old / "1_slam")
            (run_of_old / "1_slam/report.json").unlink()
            for name in ("2_lift_noisy", "3_refine_noisy", "3_refine_plain"):
                (run_of_old / name).symlink_to(self.chain / name)
            file = make_report(self.program, run_of_old, pathlib.Path(folder) / "page")
            page = devtools.Page(devtools.find_browser())
            try:
                page.open(file.as_uri())
                self.assertGreater(page.evaluate("s3lamViewer.visiblePoints()"), 500)
                for absent in ("showTruth", "trustPath"):
                    self.assertTrue(page.evaluate(f"document.getElementById('{absent}') === null"))
                self.assertEqual(page.problems, [])
            finally:
                page.close()


class Report(unittest.TestCase):
    program = chain = None

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.file = make_report(cls.program, cls.chain, pathlib.Path(cls.folder.name),
                               "--ground-truth", cls.chain / "scene/groundtruth.txt")
        cls.page = devtools.Page(devtools.find_browser())
        cls.page.open(cls.file.as_uri())

    @classmethod
    def tearDownClass(cls):
        cls.page.close()
        cls.folder.cleanup()

    def tearDown(self):
        self.page.evaluate("for (const id of ['classes', 'planes', 'clusters'])"
                           " document.getElementById(id + '-all').click()")
        self.page.evaluate("document.getElementById('arm-2').click()")
        self.assertEqual(self.page.problems, [])

    def click(self, element):
        self.page.evaluate(f"document.getElementById('{element}').click()")
        self.page.frames()

    def visible(self):
        return self.page.evaluate("s3lamViewer.visiblePoints()")

    def picture(self):
        """The pixels of the 3D view, as text."""
        self.page.frames()
        return self.page.evaluate("document.getElementById('view3d').toDataURL()")

    def test_loads_nothing_else(self):
        loaded = [url for url in self.page.requests if not url.startswith("data:")]
        self.assertEqual(loaded, [self.file.as_uri()])

    def test_shows_points(self):
        self.assertGreater(self.visible(), 500)
        colours = self.page.evaluate("""(() => {
          const gl = s3lamViewer.renderer.getContext();
          const w = gl.drawingBufferWidth, h = gl.drawingBufferHeight;
          const copy = document.createElement('canvas');
          copy.width = w; copy.height = h;
          const context = copy.getContext('2d', {willReadFrequently: true});
          context.drawImage(gl.canvas, 0, 0);
          const pixels = new Uint32Array(context.getImageData(0, 0, w, h).data.buffer);
          return new Set(pixels).size; })()""")
        self.assertGreater(colours, 20)

    def test_arms_differ(self):
        pictures = []
        for arm in range(3):
            self.click(f"arm-{arm}")
            pictures.append(self.picture())
        self.assertEqual(len(set(pictures)), 3)

    def test_classes_clusters_and_planes_are_switched(self):
        for kind in ("classes", "clusters"):
            before, shown = self.visible(), self.picture()
            self.click(kind + "-none")
            self.assertLess(self.visible(), before)
            self.assertNotEqual(self.picture(), shown)
            self.click(kind + "-all")
            self.assertEqual(self.visible(), before)
        points = self.page.evaluate("""JSON.stringify(
          Array.from(document.querySelectorAll('#clusters label')).map((l) => l.textContent))""")
        self.assertIn("(", points)
        before = self.visible()
        self.click("planes-0")
        self.assertLess(self.visible(), before)
        self.click("planes-0")
        self.assertEqual(self.visible(), before)

    def test_one_cluster_hides_its_points(self):
        before = self.visible()
        size = int(self.page.evaluate(
            "document.getElementById('clusters-0').parentElement.textContent").split("(")[1][:-1])
        self.click("clusters-0")
        self.assertEqual(self.visible(), before - size)
        self.click("clusters-0")

    def test_what_is_shown(self):
        for box in ("showPoints", "showCameras", "showPlanes", "showPath", "showTruth"):
            before = self.picture()
            self.click(box)
            self.assertNotEqual(self.picture(), before, box)
            self.click(box)
            self.assertEqual(self.picture(), before, box)
        before = self.visible()
        self.click("onlyPlanes")
        self.assertLess(self.visible(), before)
        self.click("onlyPlanes")

    def test_trajectory_by_trust(self):
        self.assertFalse(self.page.evaluate("document.getElementById('trustPath').checked"))
        self.click("showPoints")
        before = self.picture()
        self.click("trustPath")
        self.assertNotEqual(self.picture(), before)
        self.click("trustPath")
        self.assertEqual(self.picture(), before)
        self.click("showPoints")

    def test_colours_and_views(self):
        pictures = set()
        for k in range(4):
            self.click(f"color-{k}")
            pictures.add(self.picture())
        self.assertEqual(len(pictures), 4)
        self.click("color-1")
        for view in ("look-top", "look-side", "look-oblique"):
            self.click(view)
            pictures.add(self.picture())
        self.assertGreaterEqual(len(pictures), 6)

    def test_hover_tells_of_points(self):
        x, y = self.page.evaluate("""(() => {
          const box = document.getElementById('viewer').getBoundingClientRect();
          document.getElementById('viewer').scrollIntoView();
          const after = document.getElementById('viewer').getBoundingClientRect();
          for (let i = 0; i < 5000; ++i) {
            const [x, y] = s3lamViewer.screenOf(i);
            if (x > 100 && y > 100 && x < after.width - 100 && y < after.height - 100)
              return [after.left + x, after.top + y];
          } })()""")
        self.page.move_mouse(x, y)
        text = self.page.evaluate("document.getElementById('tip').innerText")
        self.assertRegex(text, r"^point \d+ at \(")
        self.assertFalse(self.page.evaluate("document.getElementById('tip').hidden"))
        self.assertRegex(text, r"\d+ % ")

    def test_hover_tells_of_planes(self):
        self.click("showPoints")
        found = self.page.evaluate("""(() => {
          const box = document.getElementById('viewer').getBoundingClientRect();
          for (let y = 20; y < box.height; y += 20) for (let x = 20; x < box.width; x += 20) {
            s3lamViewer.hover(x, y);
            const tip = document.getElementById('tip');
            if (!tip.hidden) return tip.innerText;
          }
          return ''; })()""")
        self.click("showPoints")
        self.assertRegex(found, r"^plane \d+: .*\n\d+ points\nnormal in the model \(")

    def test_screenshot(self):
        self.assertEqual(base64.b64decode(self.page.screenshot())[:4], b"\x89PNG")


if __name__ == "__main__":
    if devtools.find_browser() is None:
        print("skipped: no Chromium is installed")
        sys.exit(SKIPPED)
    Report.program, Report.chain = (pathlib.Path(a).resolve() for a in sys.argv[1:3])
    Untold.program, Untold.chain = Report.program, Report.chain
    unittest.main(argv=sys.argv[:1])
