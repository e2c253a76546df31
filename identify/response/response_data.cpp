#include "identify/response/response_data.hpp"

#include <algorithm>
#include <stdexcept>

#include "base/number_text.hpp"
#include "base/quantile.hpp"

namespace isorig::identify::response {
namespace {

/// Straight between readings, held beyond the ends. Both times increase.
std::vector<double> on_rows(const std::vector<double>& t_s, const std::vector<double>& value,
                            const std::vector<double>& rows_s) {
  std::vector<double> out;
  out.reserve(rows_s.size());
  std::size_t k = 0;
  for (const double t : rows_s) {
    while (k + 1 < t_s.size() && t_s[k + 1] <= t) ++k;
    if (k + 1 == t_s.size() || t <= t_s[k]) {
      out.push_back(value[k]);
    } else {
      const double share = (t - t_s[k]) / (t_s[k + 1] - t_s[k]);
      out.push_back(value[k] + share * (value[k + 1] - value[k]));
    }
  }
  return out;
}

/// From the lowest hundredth to the highest, against the noise: single spikes move nothing. A few steps of the reading
/// that come and go all the time are noise; a set-point of two values, held between them, is none.
bool varies(const std::vector<double>& value, const ChannelQuality& quality) {
  constexpr double kNoises = 10.0, kSeldom = 0.05;
  const double span = base::quantile(value, 0.99) - base::quantile(value, 0.01);
  double changes = 0.0;
  for (std::size_t k = 1; k < value.size(); ++k) changes += value[k] != value[k - 1];
  const bool seldom = changes < kSeldom * static_cast<double>(value.size());
  return span > kNoises * std::max(quality.noise, seldom ? 0.0 : quality.step);
}

struct Readings {
  const std::vector<double>* t_s = nullptr;
  const std::vector<double>* value = nullptr;
};

Readings readings_of(const messages::Recording& recording, std::string_view column) {
  if (column == "position_mm") return {&recording.frame.t_s, &recording.frame.position_mm};
  if (column == "force_N") return {&recording.frame.t_s, &recording.frame.force_N};
  if (recording.pressure) return {&recording.pressure->t_s, &recording.pressure->pressure_psi};
  return {};
}

Data output_of(const messages::Recording& recording, std::string name) {
  Data out;
  out.output = recording.metadata.output;
  out.name = std::move(name);
  const bool of_pressure = out.output == messages::Output::kPressure;
  if (of_pressure && !recording.pressure)
    throw std::invalid_argument(out.name + ": the pressure is the output, and there is no pressure.csv");
  out.t_s = of_pressure ? recording.pressure->t_s : recording.frame.t_s;
  out.output_value = of_pressure ? recording.pressure->pressure_psi : recording.frame.position_mm;
  return out;
}

}  // namespace

std::string_view unit_of(messages::Output output) {
  return output == messages::Output::kPressure ? "psi" : output == messages::Output::kPosition ? "mm" : "N";
}

std::vector<std::string_view> possible_inputs(messages::Output output) {
  if (output == messages::Output::kPressure) return {"position_mm"};
  return {"pressure_psi", "force_N"};
}

Data data_of(const messages::Recording& recording, std::string name) {
  Data out = output_of(recording, std::move(name));
  for (const std::string_view column : possible_inputs(out.output)) {
    const Readings of = readings_of(recording, column);
    if (of.t_s == nullptr || of.t_s->size() < 4 || !varies(*of.value, channel_quality(*of.t_s, *of.value))) continue;
    std::vector<double> value = on_rows(*of.t_s, *of.value, out.t_s);
    // What changes only where the output was not read drives nothing here.
    if (varies(value, channel_quality(out.t_s, value))) out.inputs.push_back({column, std::move(value)});
  }
  return out;
}

Data data_of(const messages::Recording& recording, std::string name, std::span<const std::string_view> inputs) {
  Data out = output_of(recording, std::move(name));
  for (const std::string_view column : inputs) {
    const Readings of = readings_of(recording, column);
    if (of.t_s == nullptr || of.t_s->empty())
      throw std::invalid_argument(out.name + ": the model answers to " + std::string(column) +
                                  ", and the recording has none");
    out.inputs.push_back({column, on_rows(*of.t_s, *of.value, out.t_s)});
  }
  return out;
}

void measure_outputs(std::span<Data> data) {
  for (Data& each : data) each.output_quality = channel_quality(each.t_s, each.output_value);
}

void require_one_question(std::span<const Data> data) {
  constexpr std::size_t kFewest = 20;
  const auto columns = [](const Data& of) {
    std::string list;
    for (const auto& input : of.inputs) list += (list.empty() ? "" : ", ") + std::string(input.column);
    return list.empty() ? std::string("nothing") : list;
  };
  for (const Data& each : data)
    if (each.output != data[0].output)
      throw std::invalid_argument(each.name + ": its output is the " + std::string(messages::name_of(each.output)) +
                                  ", that of " + data[0].name + " the " +
                                  std::string(messages::name_of(data[0].output)) + "; diagnose them apart");
  for (const Data& each : data) {
    if (each.t_s.size() < kFewest)
      throw std::invalid_argument(each.name + ": " + std::to_string(each.t_s.size()) +
                                  " rows are too few to judge a model by (at least " + std::to_string(kFewest) + ")");
    if (!varies(each.output_value, each.output_quality))
      throw std::invalid_argument(each.name + ": the " + std::string(messages::name_of(each.output)) +
                                  ", which is the output, does not change by ten times its noise");
    if (columns(each) != columns(data[0]))
      throw std::invalid_argument(each.name + ": " + columns(each) + " varies, and in " + data[0].name + " " +
                                  columns(data[0]) + "; diagnose them apart");
  }
}

}  // namespace isorig::identify::response
