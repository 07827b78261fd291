// What the report shows step by step: the strip of fingerprints, and the slider.
#include <algorithm>
#include <array>
#include <cmath>

#include "verify/fingerprint.h"
#include "verify/report_parts.h"
#include "verify/step_tree.h"

namespace sulcus::report {
namespace {

constexpr std::int64_t most_columns = 1200;

std::string stage_of(const std::string& leaf) {
  return leaf.substr(0, leaf.find('/'));
}

// The hashes of one stage of a step made one; 0 where none is recorded.
std::uint64_t stage_hash(const TreeRow& row, const std::string& stage) {
  std::uint64_t hash = 0;
  for (std::size_t leaf = 0; leaf < row.size(); ++leaf) {
    if (row[leaf] && stage_of(tree_leaf_names()[leaf]) == stage)
      hash = chain_hash(hash, std::span(&*row[leaf], 1));
  }
  return hash;
}

using Pixel = std::array<std::uint8_t, 3>;

// A colour of one lightness, its hue from the hash.
Pixel colour_of_hash(std::uint64_t hash) {
  const double hue = 6 * static_cast<double>(hash >> 40) * 0x1p-24;
  const auto channel = [&](double shift) {
    const double k = std::fmod(hue + shift, 6);
    return static_cast<std::uint8_t>(90 + 140 * std::clamp(std::min(k, 4 - k), 0.0, 1.0));
  };
  return {channel(5), channel(3), channel(1)};
}

}  // namespace

const std::vector<std::string>& fingerprint_strip_rows() {
  static const std::vector<std::string> rows = [] {
    std::vector<std::string> stages;
    for (const std::string& leaf : tree_leaf_names()) {
      if (stages.empty() || stages.back() != stage_of(leaf)) stages.push_back(stage_of(leaf));
    }
    return stages;
  }();
  return rows;
}

Image fingerprint_strip(const RunData& run) {
  const auto& stages = fingerprint_strip_rows();
  const std::int64_t columns = std::min(run.steps, most_columns);
  Image strip;
  strip.width = static_cast<int>(columns);
  strip.height = static_cast<int>(stages.size());
  strip.rgb.resize(3 * stages.size() * static_cast<std::size_t>(columns));
  constexpr Pixel unchanged{205, 208, 214}, absent{240, 240, 240};
  std::vector<std::uint64_t> before(stages.size(), 0);
  for (std::int64_t column = 0; column < columns; ++column) {
    const std::int64_t step = (column + 1) * run.steps / columns;
    const TreeRow row = recorded_tree_row(run, step);
    for (std::size_t s = 0; s < stages.size(); ++s) {
      const std::uint64_t hash = stage_hash(row, stages[s]);
      const Pixel pixel = hash == 0 ? absent : hash == before[s] ? unchanged : colour_of_hash(hash);
      std::copy(pixel.begin(), pixel.end(),
                strip.rgb.begin() + 3 * (static_cast<std::ptrdiff_t>(s) * columns + column));
      before[s] = hash;
    }
  }
  return strip;
}

std::string fingerprint_section(const RunData& run) {
  if (run.steps == 0 || run.field_names.empty()) return "";
  std::string html =
      "<h3>Fingerprints</h3>\n<p class=\"note\">A colour for what each stage of each step left, made of its "
      "hash: the "
      "same colour, the same bits; grey, the same as the step before.</p>\n<div class=\"strip\"><ol>";
  for (const std::string& stage : fingerprint_strip_rows()) html += "<li>" + stage + "</li>";
  return html +
         "</ol><img alt=\"strip of fingerprints, steps from left to right\" src=\"data:image/png;base64," +
         base64(encode_png(fingerprint_strip(run))) + "\"></div>\n";
}

std::string slider(const RunData& run) {
  if (run.steps < 2) return "";
  const std::string last = std::to_string(run.steps);
  return "<div class=\"slider\"><input type=\"range\" aria-label=\"step\" min=\"0\" max=\"" + last +
         "\" value=\"" + last + "\" data-step=\"" + std::to_string(run.header.step_s) +
         "\"><output></output></div>\n";
}

const char* const slider_script = R"(<script>
document.documentElement.classList.add('live');
document.querySelectorAll('section.run').forEach(run => {
  const input = run.querySelector('.slider input');
  if (!input) return;
  const output = run.querySelector('.slider output');
  const pictures = [...run.querySelectorAll('.pictures figure[data-time]')];
  if (pictures.length > 1) pictures[0].parentElement.classList.add('timed');
  const charts = [...run.querySelectorAll('.charts svg[data-from]')].map(svg => {
    svg.insertAdjacentHTML('beforeend', '<line class="cursor" y1="34" y2="242" stroke="currentColor" ' +
                                        'stroke-width="1.2" stroke-dasharray="2 2"/>');
    const cursor = svg.lastElementChild;
    const {left, right, from, to} = svg.dataset;
    return {cursor, left: +left, right: +right, from: +from, to: +to};
  });
  const show = () => {
    const time = input.value * input.dataset.step;
    output.textContent = 'step ' + input.value + ' · ' + time.toFixed(2) + ' s';
    const until = pictures.filter(p => +p.dataset.time <= time + 1e-9);
    const latest = until.length ? Math.max(...until.map(p => +p.dataset.time)) : +pictures[0]?.dataset.time;
    pictures.forEach(p => p.classList.toggle('now', +p.dataset.time === latest));
    charts.forEach(c => {
      const x = c.left + (c.right - c.left) * (time - c.from) / (c.to - c.from);
      const inside = x >= c.left - 1 && x <= c.right + 1;
      c.cursor.setAttribute('x1', x);
      c.cursor.setAttribute('x2', x);
      c.cursor.style.display = inside ? '' : 'none';
    });
  };
  input.addEventListener('input', show);
  show();
});
</script>
)";

}  // namespace sulcus::report
