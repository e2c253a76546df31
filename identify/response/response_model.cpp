#include "identify/response/response_model.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <sstream>
#include <stdexcept>

#include "base/number_text.hpp"
#include "base/toml_reader.hpp"
#include "model/stepping.hpp"

namespace isorig::identify::response {
namespace {

constexpr const char* kFormat = "isorig-response/1";

std::string list_of(const std::vector<double>& values) {
  std::string text = "[";
  for (const double value : values) text += (text.size() > 1 ? ", " : "") + base::exact_number_text(value);
  return text + "]";
}

double settled_share(const ResponseModel& model, double t_s, double y0) {
  if (y0 == model.rest) return 1.0;  // of nothing
  if (model.exponent != 1.0) {
    const double order = model.exponent - 1.0;
    const double time_s = model.times_s[0] * std::pow(std::fabs((y0 - model.rest) / model.scale), -order);
    const double bracket = 1.0 + order * t_s / time_s;
    return bracket > 0.0 ? std::pow(bracket, -1.0 / order) : 0.0;
  }
  double left = 0.0;
  for (std::size_t i = 0; i < model.times_s.size(); ++i) left += model.shares[i] * std::exp(-t_s / model.times_s[i]);
  return left;
}

void add_answer(const ResponseModel& model, const ResponseModel::Input& to, const std::vector<double>& value,
                const std::vector<double>& t_s, std::vector<double>& out) {
  std::vector<model::MaxwellState> units;
  for (const double time_s : model.times_s) units.emplace_back(time_s);
  double play = 0.0;
  for (std::size_t k = 1; k < out.size(); ++k) {
    const double change = value[k] - value[0];
    play = std::clamp(play, change - to.play_width, change + to.play_width);
    out[k] += to.immediate * change + to.play_gain * play;
    for (std::size_t i = 0; i < units.size(); ++i)
      out[k] += to.retarded[i] * (change - units[i].step(value[k] - value[k - 1], t_s[k] - t_s[k - 1]));
  }
}

}  // namespace

std::vector<double> simulate(const ResponseModel& model, const Data& of, double y0) {
  std::vector<double> out(of.t_s.size(), y0);
  for (std::size_t k = 0; k < out.size(); ++k) {
    const double t_s = of.t_s[k] - of.t_s[0];
    if (model.inputs.empty()) out[k] = model.rest + (y0 - model.rest) * settled_share(model, t_s, y0);
    out[k] += model.drift_per_h * t_s / kHour_s;
  }
  for (const ResponseModel::Input& input : model.inputs)
    for (const Data::Input& given : of.inputs)
      if (given.column == input.column) add_answer(model, input, given.value, of.t_s, out);
  return out;
}

Data data_for(const messages::Recording& recording, std::string name, const ResponseModel& model) {
  std::vector<std::string_view> columns;
  for (const auto& input : model.inputs) columns.emplace_back(input.column);
  if (columns.empty()) {
    if (const Data driven = data_of(recording, name); !driven.inputs.empty())
      throw std::invalid_argument(
          name + ": " + std::string(driven.inputs[0].column) +
          " varies, and the model settles without an input; diagnose a recording like this one");
  }
  return data_of(recording, std::move(name), columns);
}

double begin_of(const Data& data) {
  constexpr std::size_t kMost = 10;
  constexpr double kShare = 0.01;
  const double until_s = data.t_s.front() + kShare * (data.t_s.back() - data.t_s.front());
  std::size_t n = 0;
  double mean_s = 0.0, mean = 0.0;
  for (; n < std::min(kMost, data.t_s.size()) && (n == 0 || data.t_s[n] <= until_s); ++n) {
    mean_s += data.t_s[n] - data.t_s[0];
    mean += data.output_value[n];
  }
  if (n < 3) return data.output_value[0];
  mean_s /= static_cast<double>(n);
  mean /= static_cast<double>(n);
  double squares = 0.0, products = 0.0;
  for (std::size_t k = 0; k < n; ++k) {
    const double from_s = data.t_s[k] - data.t_s[0] - mean_s;
    squares += from_s * from_s;
    products += from_s * (data.output_value[k] - mean);
  }
  return mean - products / squares * mean_s;
}

bool is_response_model(const std::filesystem::path& file) {
  // A device has no end, and a pipe nothing that could be read twice.
  if (std::error_code error; !std::filesystem::is_regular_file(file, error)) return false;
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);)
    if (line.starts_with("format")) return line.find(kFormat) != std::string::npos;
  return false;
}

ResponseModel read_response_model(const std::filesystem::path& file) {
  constexpr base::Range kTime{0.0, 1e9, true}, kFinite{-1e12, 1e12};
  const auto document = base::TomlDocument::parse_file(file);
  const auto root = document.root();
  ResponseModel out;
  static_cast<void>(root.choice("format", {kFormat}));
  out.name = root.string("name");
  out.output = root.choice("output", {"position", "pressure"}) == "pressure" ? messages::Output::kPressure
                                                                             : messages::Output::kPosition;
  out.times_s = root.numbers("times_s", kTime);
  if (out.times_s.empty()) root.error("times_s", "at least one retardation time is needed");
  out.drift_per_h = root.number_or("drift_per_h", 0.0, kFinite);
  out.error = root.number_or("error", 0.0, {0.0, 1e12});
  for (const auto& table : root.tables("input")) {
    ResponseModel::Input input;
    input.column = table.choice("column", {"pressure_psi", "force_N", "position_mm"});
    input.immediate = table.number("immediate", kFinite);
    input.retarded = table.numbers("retarded", kFinite);
    if (input.retarded.size() != out.times_s.size())
      table.error("retarded", "as many numbers as times_s has are needed (" + std::to_string(out.times_s.size()) + ")");
    input.play_width = table.number_or("play_width", 0.0, {0.0, 1e12});
    input.play_gain = table.number_or("play_gain", 0.0, kFinite);
    out.inputs.push_back(std::move(input));
  }
  if (out.inputs.empty()) {
    out.rest = root.number("rest", kFinite);
    out.shares = root.numbers("shares", {-1e3, 1e3});
    out.exponent = root.number_or("exponent", 1.0, {0.0, 10.0, true});
    if (out.exponent != 1.0) out.scale = root.number("scale", {0.0, 1e12, true});
    if (out.shares.size() != out.times_s.size())
      root.error("shares", "as many numbers as times_s has are needed (" + std::to_string(out.times_s.size()) + ")");
    if (out.exponent != 1.0 && out.times_s.size() > 1)
      root.error("exponent", "an exponent other than 1 goes with one time alone");
  }
  document.finish();
  return out;
}

std::string response_model_text(const ResponseModel& model, std::string_view comment) {
  std::ostringstream out;
  std::istringstream lines{std::string(comment)};
  for (std::string line; std::getline(lines, line);) out << "# " << line << '\n';
  out << "format = \"" << kFormat << "\"\nname = \"" << model.name << "\"\noutput = \""
      << messages::name_of(model.output) << "\"\ntimes_s = " << list_of(model.times_s) << '\n';
  if (model.drift_per_h != 0.0) out << "drift_per_h = " << base::exact_number_text(model.drift_per_h) << '\n';
  if (model.error > 0.0) out << "error = " << base::exact_number_text(model.error) << '\n';
  if (model.inputs.empty()) {
    out << "rest = " << base::exact_number_text(model.rest) << "\nshares = " << list_of(model.shares) << '\n';
    if (model.exponent != 1.0)
      out << "exponent = " << base::exact_number_text(model.exponent)
          << "\nscale = " << base::exact_number_text(model.scale) << '\n';
  }
  for (const auto& input : model.inputs) {
    out << "\n[[input]]\ncolumn = \"" << input.column << "\"\nimmediate = " << base::exact_number_text(input.immediate)
        << "\nretarded = " << list_of(input.retarded) << '\n';
    if (input.play_gain != 0.0)
      out << "play_width = " << base::exact_number_text(input.play_width)
          << "\nplay_gain = " << base::exact_number_text(input.play_gain) << '\n';
  }
  return out.str();
}

}  // namespace isorig::identify::response
