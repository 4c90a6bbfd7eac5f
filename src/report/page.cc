#include "s3lam/report/page.h"

#include <fmt/format.h>

#include <opencv2/imgcodecs.hpp>

#include "assets.h"
#include "s3lam/base/version.h"
#include "s3lam/report/html_text.h"
#include "s3lam/report/trust_strip.h"

namespace s3lam::report {
namespace {

/// The browser itself is told to load nothing that is not in the file.
constexpr const char* kHead = R"(<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'">
<meta name="viewport" content="width=device-width, initial-scale=1">
)";

constexpr const char* kViewerUpToTruth = R"(<h2>Map</h2>
<div id="view-row">
<div id="viewer"><canvas id="view3d"></canvas><div id="viewer-note">The 3D view needs scripts.</div><div id="tip" hidden></div></div>
<div id="controls">
<fieldset id="arms"><legend>Map</legend></fieldset>
<fieldset id="colors"><legend>Colour of points</legend></fieldset>
<fieldset><legend>Shown</legend>
<label><input type="checkbox" id="showPoints" checked> points</label>
<label><input type="checkbox" id="showPlanes" checked> planes and normals</label>
<label><input type="checkbox" id="showCameras" checked> keyframes</label>
<label><input type="checkbox" id="showPath" checked> trajectory</label>
)";

constexpr const char* kTruthSwitch =
    R"(<label><input type="checkbox" id="showTruth" checked> ground truth</label>
)";

constexpr const char* kViewerAfterTruth =
    R"(<label><input type="checkbox" id="unlabelled" checked> points in no object</label>
<label><input type="checkbox" id="onlyPlanes"> only points on planes</label>
<label>size of points <input type="range" id="point-size" min="1" max="8" step="0.5" value="2"></label>
<div id="visible-count"></div>
<button id="look-top">top</button> <button id="look-oblique">3/4</button> <button id="look-side">side</button>
</fieldset>
<fieldset><legend>Classes <button id="classes-all">all</button> <button id="classes-none">none</button></legend><div class="list" id="classes"></div></fieldset>
<fieldset><legend>Planes <button id="planes-all">all</button> <button id="planes-none">none</button></legend><div class="list" id="planes"></div></fieldset>
<fieldset><legend>Objects <button id="clusters-all">all</button> <button id="clusters-none">none</button></legend><div class="list" id="clusters"></div></fieldset>
</div>
</div>
<p class="note">Drag to turn, wheel to come nearer, right button to move. A point or plane under the pointer tells what is known of it.</p>
)";

std::string DataUri(const cv::Mat& image, bool photograph, int jpeg_quality) {
  std::vector<uchar> bytes;
  const bool done =
      photograph ? cv::imencode(".jpg", image, bytes, {cv::IMWRITE_JPEG_QUALITY, jpeg_quality})
                 : cv::imencode(".png", image, bytes,
                                {cv::IMWRITE_PNG_COMPRESSION, 9, cv::IMWRITE_PNG_STRATEGY,
                                 cv::IMWRITE_PNG_STRATEGY_DEFAULT});
  if (!done) throw std::runtime_error("cannot encode a picture of the report");
  return fmt::format("data:image/{};base64,{}", photograph ? "jpeg" : "png",
                     Base64({reinterpret_cast<const char*>(bytes.data()), bytes.size()}));
}

std::string SentencesToHtml(const std::vector<std::string>& sentences, const char* css_class) {
  if (sentences.empty()) return {};
  std::string html = fmt::format("<ul class=\"{}\">\n", css_class);
  for (const std::string& sentence : sentences) html += "<li>" + EscapeHtml(sentence) + "</li>\n";
  return html + "</ul>\n";
}

/// With what the colours mean.
std::string TrustSwitch() {
  std::string html = "<label><input type=\"checkbox\" id=\"trustPath\"> trajectory by trust:";
  for (const FrameState state : {FrameState::kGood, FrameState::kWeak}) {
    const Rgb color = StateColor(state);
    html += fmt::format(
        " <span class=\"key\"><span class=\"swatch\" style=\"background: rgb({}, {}, "
        "{})\"></span>{}</span>",
        color[0], color[1], color[2], StateTitle(state));
  }
  return html + "</label>\n";
}

std::string TableToHtml(const Table& table) {
  std::string html = "<div class=\"scroll\"><table>\n<tr>";
  const auto css = [&](size_t column) {
    return column < table.num_text_columns ? " class=\"text\"" : "";
  };
  for (size_t i = 0; i < table.header.size(); ++i) {
    html += fmt::format("<th{}>{}</th>", css(i), EscapeHtml(table.header[i]));
  }
  html += "</tr>\n";
  for (const auto& row : table.rows) {
    html += "<tr>";
    for (size_t i = 0; i < row.size(); ++i) {
      html += fmt::format("<td{}>{}</td>", css(i), EscapeHtml(row[i]));
    }
    html += "</tr>\n";
  }
  return html + "</table></div>\n";
}

std::string FigureToHtml(const Figure& figure, int jpeg_quality) {
  const std::string caption = EscapeHtml(figure.caption);
  std::string html = "<figure>";
  if (const auto* drawing = std::get_if<Drawing>(&figure.picture)) {
    html += drawing->ToSvg();
  } else {
    const auto& image = std::get<cv::Mat>(figure.picture);
    html += fmt::format("<img src=\"{}\" width=\"{}\" height=\"{}\" alt=\"{}\">",
                        DataUri(image, figure.section == "keyframes", jpeg_quality), image.cols,
                        image.rows, caption);
  }
  if (!caption.empty()) html += "<figcaption>" + caption + "</figcaption>";
  return html + "</figure>\n";
}

/// With `columns`, in a grid of so many; else as many in a row as fit.
std::string FiguresToHtml(const PageContent& content, const char* section, const char* title,
                          size_t columns = 0) {
  std::string figures;
  for (const Figure& figure : content.figures) {
    if (figure.section == section) figures += FigureToHtml(figure, content.jpeg_quality);
  }
  if (figures.empty()) return {};
  const std::string grid =
      columns > 0 ? fmt::format(" grid\" style=\"--columns: {}", columns) : std::string();
  return fmt::format("<h2>{}</h2>\n<div class=\"figures {}{}\">\n{}</div>\n", title, section, grid,
                     figures);
}

void AppendScripts(const PageContent& content, std::string& html) {
  html += "<script type=\"application/json\" id=\"viewer-meta\">";
  html += JsonForScript(content.viewer.meta);
  html += "</script>\n";
  for (const auto& [name, base64] : content.viewer.arrays) {
    html += "<script type=\"text/plain\" id=\"data-" + name + "\">";
    html += base64;
    html += "</script>\n";
  }
  html += "<script>\n/*\nthree.js, of which the following script is a part:\n\n";
  html += assets::kThreeLicense;
  html += "*/\n";
  html += assets::kThree;
  html += "</script>\n<script>\n";
  html += assets::kViewer;
  html += "</script>\n";
}

}  // namespace

std::string MakePage(const PageContent& content) {
  const std::string title = EscapeHtml(content.title);
  std::string html = kHead;
  html += "<title>" + title + "</title>\n<style>\n";
  html += assets::kStyle;
  html += "</style>\n</head>\n<body>\n<h1>" + title + "</h1>\n";
  html += SentencesToHtml(content.doubts, "doubts");
  html += SentencesToHtml(content.missing, "missing");
  html += TableToHtml(content.summary);
  html += FiguresToHtml(content, "trust", "Trust in the frames");
  html += kViewerUpToTruth;
  if (content.viewer.has_trust) html += TrustSwitch();
  if (content.viewer.has_truth) html += kTruthSwitch;
  html += kViewerAfterTruth;
  html += FiguresToHtml(content, "map", "The map from the top, at three quarters and from the side",
                        content.viewer.meta.at("arms").size());
  html += FiguresToHtml(content, "trajectory", "Trajectory");
  html += FiguresToHtml(content, "residuals", "Residuals");
  html += FiguresToHtml(content, "keyframes", "Keyframes");
  for (const Table& table : content.tables) {
    if (table.rows.empty()) continue;
    html += "<h2>" + EscapeHtml(table.title) + "</h2>\n" + TableToHtml(table);
  }
  if (!content.configurations.empty()) html += "<h2>Effective configuration</h2>\n";
  for (const auto& [name, config] : content.configurations) {
    const std::string text = config.dump(2, ' ', false, nlohmann::json::error_handler_t::replace);
    html += "<details><summary>" + EscapeHtml(name) + "</summary><pre>" + EscapeHtml(text) +
            "</pre></details>\n";
  }
  html += fmt::format("<p class=\"note\">Made by s3-report {}.</p>\n", Version());
  AppendScripts(content, html);
  return html + "</body>\n</html>\n";
}

}  // namespace s3lam::report
