#pragma once
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "identify/diagnose/signal/channel_quality.hpp"
#include "messages/recording.hpp"

namespace isorig::identify::response {

/// One recording as a question of this room: what answers (`output`, in its unit) to what (`inputs`), at the rows of
/// the output's own file.
struct Data {
  std::string name;
  messages::Output output = messages::Output::kPosition;
  std::vector<double> t_s;
  std::vector<double> output_value;  ///< mm or psi
  ChannelQuality output_quality;     ///< zeros before measure_outputs()
  struct Input {
    std::string_view column;  ///< "pressure_psi", "force_N", "position_mm"
    std::vector<double> value;
  };
  std::vector<Input> inputs;  ///< those that vary by more than their noise
};

/// "mm" or "psi": of the output, in names of numbers and for people.
[[nodiscard]] std::string_view unit_of(messages::Output output);

/// Which columns a recording with this output may be driven by.
[[nodiscard]] std::vector<std::string_view> possible_inputs(messages::Output output);

/// Inputs on the rows of the output by straight lines between readings, held beyond the ends. A column is an input when
/// it varies by more than ten times its noise. The output itself is copied and not looked at. Throws
/// std::invalid_argument where the output's file is missing.
[[nodiscard]] Data data_of(const messages::Recording& recording, std::string name);
/// The same with these inputs, whether they vary or not: those of a model. Throws std::invalid_argument for one that
/// the recording does not have.
[[nodiscard]] Data data_of(const messages::Recording& recording, std::string name,
                           std::span<const std::string_view> inputs);

/// How well each output was read. Once, for all who judge by it: a prediction does not look at the output at all.
void measure_outputs(std::span<Data> data);

/// Of outputs that were measured. Throws std::invalid_argument for what cannot be diagnosed together, or at all: fewer
/// than 20 rows, an output that stands still, outputs or inputs that are not the same columns in all recordings.
void require_one_question(std::span<const Data> data);

}  // namespace isorig::identify::response
