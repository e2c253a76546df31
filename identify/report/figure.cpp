#include "identify/report/figure.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <nlohmann/json.hpp>
#include <stdexcept>

namespace isorig::identify::report {
namespace {

using nlohmann::ordered_json;

void check(const Figure& figure) {
  auto refuse = [&](const std::string& why) { throw std::invalid_argument("figure '" + figure.name + "': " + why); };
  if (figure.name.empty() || figure.name.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"
                                                           "0123456789-_") != std::string::npos)
    refuse("a name is made of letters, digits, '-' and '_'");
  if (figure.panels.empty()) refuse("no panels");
  if (figure.columns < 1) refuse("columns must be at least 1");
  for (const Panel& panel : figure.panels)
    for (const Series& s : panel.series) {
      if (s.x.size() != s.y.size()) refuse("x and y have different lengths");
      if (!s.error.empty() && s.error.size() != s.x.size()) refuse("error and x have different lengths");
      if (!s.error_below.empty() && s.error_below.size() != s.error.size())
        refuse("error_below and error have different lengths");
      if (s.mark == Mark::kBand && s.y2.size() != s.x.size()) refuse("y2 and x have different lengths");
    }
}

const char* name_of(Mark mark) {
  switch (mark) {
    case Mark::kLine:
      return "line";
    case Mark::kDashes:
      return "dashes";
    case Mark::kPoints:
      return "points";
    case Mark::kLinePoints:
      return "line-points";
    case Mark::kSteps:
      return "steps";
    case Mark::kBand:
      return "band";
    case Mark::kBars:
      return "bars";
  }
  return "";
}

/// Rounded to what can be seen: 1/100 000 of what the values span. Their 17 digits would make a page of noise.
ordered_json numbers(std::span<const double> values) {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const double v : values)
    if (std::isfinite(v)) {
      low = std::min(low, v);
      high = std::max(high, v);
    }
  const double largest = std::max(std::abs(low), std::abs(high)), span = high - low;
  int digits = 5;
  if (std::isfinite(span) && span > 0.0)
    digits = std::clamp(5 + static_cast<int>(std::ceil(std::log10(largest / span))), 5, 12);
  ordered_json out = ordered_json::array();
  for (const double v : values) {
    if (!std::isfinite(v)) {
      out.push_back(nullptr);
      continue;
    }
    char text[40];
    std::snprintf(text, sizeof text, "%.*g", digits, v);
    const double rounded = std::strtod(text, nullptr);
    if (rounded == std::floor(rounded) && std::abs(rounded) < 1e15)
      out.push_back(static_cast<std::int64_t>(rounded));
    else
      out.push_back(rounded);
  }
  return out;
}

ordered_json axis(const std::string& label, const std::optional<std::pair<double, double>>& range, bool log) {
  ordered_json out{{"name", label}};
  if (range) out["range"] = {range->first, range->second};
  if (log) out["log"] = true;
  return out;
}

ordered_json lines(const std::vector<std::pair<double, std::string>>& at) {
  ordered_json out = ordered_json::array();
  for (const auto& [where, label] : at) {
    out.push_back({{"at", where}});
    if (!label.empty()) out.back()["label"] = label;
  }
  return out;
}

ordered_json panel_json(const Panel& panel) {
  ordered_json out;
  if (!panel.title.empty()) out["title"] = panel.title;
  out["x"] = axis(panel.x_label, panel.x_range, panel.log_x);
  if (!panel.categories.empty()) out["x"]["categories"] = panel.categories;
  out["y"] = axis(panel.y_label, panel.y_range, panel.log_y);
  if (panel.aspect > 0.0) out["aspect"] = panel.aspect;
  out["series"] = ordered_json::array();
  int next = 0;
  for (const Series& s : panel.series) {
    if (s.x.empty()) continue;
    ordered_json one{{"mark", name_of(s.mark)}};
    one["color"] = s.color >= 0 ? s.color : next++;
    if (!s.label.empty()) one["label"] = s.label;
    if (s.width > 0.0) one["width"] = s.width;
    one["x"] = numbers(s.x);
    one["y"] = numbers(s.y);
    if (s.mark == Mark::kBand) one["y2"] = numbers(s.y2);
    if (!s.error.empty()) one["error"] = numbers(s.error);
    if (!s.error_below.empty()) one["error_below"] = numbers(s.error_below);
    out["series"].push_back(std::move(one));
  }
  if (!panel.verticals.empty()) out["verticals"] = lines(panel.verticals);
  if (!panel.horizontals.empty()) out["horizontals"] = lines(panel.horizontals);
  for (const auto& [from, to] : panel.shaded) out["shaded"].push_back({{"from", from}, {"to", to}});
  return out;
}

}  // namespace

ordered_json figure_json(const Figure& figure) {
  check(figure);
  ordered_json out{{"name", figure.name}, {"caption", figure.caption}, {"columns", figure.columns}};
  if (figure.linked) out["linked"] = true;
  out["panels"] = ordered_json::array();
  for (const Panel& panel : figure.panels) out["panels"].push_back(panel_json(panel));
  return out;
}

std::vector<Series> enveloped(std::span<const double> x, std::span<const double> y, const std::string& label, int color,
                              std::size_t stretches) {
  Series line;
  line.label = label;
  line.color = color;
  double from = std::numeric_limits<double>::infinity(), to = -from;
  std::size_t finite = 0;
  for (std::size_t i = 0; i < x.size(); ++i)
    if (std::isfinite(x[i]) && std::isfinite(y[i])) {
      from = std::min(from, x[i]);
      to = std::max(to, x[i]);
      ++finite;
    }
  if (finite <= stretches || !(to > from)) {
    std::vector<std::size_t> order;
    for (std::size_t i = 0; i < x.size(); ++i)
      if (std::isfinite(x[i]) && std::isfinite(y[i])) order.push_back(i);
    std::ranges::stable_sort(order, {}, [&](std::size_t i) { return x[i]; });
    for (const std::size_t i : order) {
      line.x.push_back(x[i]);
      line.y.push_back(y[i]);
    }
    return {std::move(line)};
  }
  struct Stretch {
    double low = 0.0, high = 0.0, sum = 0.0;
    std::size_t count = 0;
  };
  std::vector<Stretch> all(stretches);
  const double width = (to - from) / static_cast<double>(stretches);
  for (std::size_t i = 0; i < x.size(); ++i) {
    if (!std::isfinite(x[i]) || !std::isfinite(y[i])) continue;
    Stretch& s = all[std::min(stretches - 1, static_cast<std::size_t>((x[i] - from) / width))];
    s.low = s.count == 0 ? y[i] : std::min(s.low, y[i]);
    s.high = s.count == 0 ? y[i] : std::max(s.high, y[i]);
    s.sum += y[i];
    ++s.count;
  }
  Series band;
  band.label = label;
  band.mark = Mark::kBand;
  band.color = color;
  for (std::size_t k = 0; k < stretches; ++k) {
    if (all[k].count == 0) continue;
    const double middle = from + (static_cast<double>(k) + 0.5) * width;
    band.x.push_back(middle);
    band.y.push_back(all[k].low);
    band.y2.push_back(all[k].high);
    line.x.push_back(middle);
    line.y.push_back(all[k].sum / static_cast<double>(all[k].count));
  }
  line.width = 1.1;
  return {std::move(band), std::move(line)};
}

Series enveloped_band(std::span<const double> x, std::span<const double> low, std::span<const double> high,
                      const std::string& label, int color, std::size_t stretches) {
  Series out;
  out.label = label;
  out.mark = Mark::kBand;
  out.color = color;
  if (x.empty()) return out;
  const double from = x.front(), width = (x.back() - from) / static_cast<double>(stretches);
  std::size_t at = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    const std::size_t now = width > 0.0 ? std::min(stretches - 1, static_cast<std::size_t>((x[i] - from) / width)) : 0;
    if (i > 0 && now == at) {
      out.y.back() = std::min(out.y.back(), low[i]);
      out.y2.back() = std::max(out.y2.back(), high[i]);
      continue;
    }
    at = now;
    out.x.push_back(x[i]);
    out.y.push_back(low[i]);
    out.y2.push_back(high[i]);
  }
  if (out.x.back() < x.back()) {  // else it would end a stretch before what it is a band of
    out.x.push_back(x.back());
    out.y.push_back(out.y.back());
    out.y2.push_back(out.y2.back());
  }
  return out;
}

}  // namespace isorig::identify::report
