#include "identify/diagnose/prepare.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <span>
#include <stdexcept>

#include "base/formatted.hpp"
#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/fit/row_weights.hpp"
#include "identify/diagnose/force_zeros.hpp"
#include "identify/diagnose/guard/missed_motion.hpp"
#include "identify/diagnose/guard/plausible.hpp"
#include "identify/diagnose/guard/start_up_cut.hpp"
#include "identify/diagnose/signal/mains_hum.hpp"
#include "messages/recording_id.hpp"
#include "model/catalogue.hpp"
#include "model/elements.hpp"

namespace isorig::identify {
namespace {

struct Admitted {
  /// Of the recording before rows are cut from it: `predict` sees the whole of it.
  double duration_s = 0.0;
  double id = 0.0;
  RecordingQuality quality;        ///< of the rows that are left
  bool begins_in_a_state = false;  ///< of its arms, which is among the nominal model's unknowns
};

bool position_moves(const messages::Recording& recording, const RecordingQuality& quality) {
  const auto& frame = recording.frame;
  if (frame.size() < 2) return false;
  const auto [low, high] = std::ranges::minmax_element(frame.position_mm);
  return *high - *low > deciding().moves_noises * quality.position.noise;
}

bool pressure_moves(const messages::Recording& recording, const RecordingQuality& quality) {
  if (!recording.pressure || recording.pressure->size() < 20) return false;
  const auto& gauge = *recording.pressure;
  const auto [low, high] = std::ranges::minmax_element(gauge.pressure_psi);
  return *high - *low > deciding().moves_noises * quality.pressure.noise;
}

/// Filling stretches the specimen, and its arms still hold some of that force when the rows of the filling have been
/// cut off; the same holds for a motion while no readings came. This is an unknown state, not physics that the nominal
/// model lacks.
void add_unknown_state(model::ModelSpec& spec, double recording_id, double start_s) {
  const model::Physics& physics = model::element::arm_start();
  const auto arms = std::ranges::count(spec.parts, &model::element::maxwell(), &model::Part::physics);
  for (std::ptrdiff_t arm = 1; arm <= arms; ++arm) {
    model::Part part = model::make_part(physics, physics.laws[0]);
    part.parameters[1] = static_cast<double>(arm);
    part.parameters[2] = recording_id;
    part.parameters[3] = start_s;
    spec.parts.push_back(std::move(part));
  }
}

/// Whether a recording begins where another of the same clock has ended, with what that has left in the arms: a logger
/// began a new file, or each test of a session was saved by itself. A pause as long as the other recording is taken for
/// a rest. Recordings that all count from their own beginning say nothing of what was before.
bool goes_on(const messages::Recording& recording, std::span<const messages::Recording> all) {
  return std::ranges::any_of(all, [&](const messages::Recording& other) {
    const double begin_s = other.frame.t_s.front(), end_s = other.frame.t_s.back();
    const double pause_s = recording.frame.t_s.front() - end_s;
    return pause_s > 0.0 && pause_s < end_s - begin_s;
  });
}

/// An isometric recording is driven by its pressure alone: its filling is the experiment.
bool may_be_cut(const messages::Recording& recording, const RecordingQuality& quality, const model::ModelSpec& model) {
  return position_moves(recording, quality) || !model.driven_by_pressure();
}

/// Cuts the session's own filling off and refuses what no model can be judged by.
Admitted admit(messages::Recording& recording, const std::string& name, model::ModelSpec& nominal,
               std::vector<DataFault>& faults) {
  const std::size_t fewest = deciding().fewest_rows;
  const auto& t_s = recording.frame.t_s;
  Admitted admitted{t_s.empty() ? 0.0 : t_s.back() - t_s.front(), messages::recording_id(recording),
                    recording_quality(recording)};
  if (may_be_cut(recording, admitted.quality, nominal)) {
    const double start_s = t_s.empty() ? 0.0 : t_s.front();
    if (auto cut = cut_start_up(recording)) {
      faults.push_back(std::move(*cut));
      admitted.quality = recording_quality(recording);
    }
    admitted.begins_in_a_state = !t_s.empty() && t_s.front() > start_s;
    if (admitted.begins_in_a_state) add_unknown_state(nominal, admitted.id, t_s.front());
  }
  for (const double again_s : missed_motion(recording.frame, admitted.quality.position))
    add_unknown_state(nominal, admitted.id, again_s);
  if (recording.frame.size() < fewest)
    throw std::invalid_argument(name + ": " + std::to_string(recording.frame.size()) +
                                " rows are too few to judge a model by (at least " + std::to_string(fewest) + ")");
  if (!position_moves(recording, admitted.quality) &&
      !(nominal.driven_by_pressure() && pressure_moves(recording, admitted.quality)))
    throw std::invalid_argument(
        name + ": nothing moves in this recording, or its samples are too far apart to follow the motion");
  refuse_implausible(recording, name, nominal, admitted.quality.position);
  refuse_two_clocks(recording, name);
  if (auto odd = odd_pressure(recording)) faults.push_back(std::move(*odd));
  return admitted;
}

/// Rows that are one reading and may hold hum: one that stands for more readings is a mean, without hum.
std::vector<bool> single_readings(const messages::FrameSamples& frame, const ChannelQuality& quality,
                                  const std::vector<bool>& usable) {
  const RowWeights readings = row_weights(frame, quality);
  std::vector<bool> single(frame.size());
  for (std::size_t k = 0; k < single.size(); ++k)
    single[k] = (usable.empty() || usable[k]) && readings.per_row[k] < deciding().single_reading_most;
  return single;
}

void take_out(const MainsHum& hum, messages::FrameSamples& frame, ChannelQuality& quality) {
  for (std::size_t k = 0; k < frame.size(); ++k) frame.force_N[k] -= hum.reading[k];
  quality = channel_quality(frame.t_s, frame.force_N);
}

/// Hum of the mains is neither white nor an Ornstein-Uhlenbeck process, so that rests measure it wrongly, and it is no
/// physics of the specimen: it is taken out of the force.
void take_hum_out(messages::FrameSamples& frame, ChannelQuality& quality, const std::vector<bool>& usable,
                  std::vector<DataFault>& faults) {
  constexpr double kFewMeans = 0.1;  // of those that there seemed to be
  const std::vector<bool> single = single_readings(frame, quality, usable);
  auto hum = find_mains_hum(frame.t_s, frame.force_N, single);
  if (!hum) return;
  messages::FrameSamples clean = frame;
  ChannelQuality clean_quality;
  // Readings half a period of the mains apart are the rougher for it, and single readings that are further apart look
  // like means beside them. Without the hum of all rows they look like what they are.
  const std::vector<bool> all = usable.empty() ? std::vector<bool>(frame.size(), true) : usable;
  const auto means = [&](const std::vector<bool>& of) {
    return static_cast<double>(std::ranges::count(all, true) - std::ranges::count(of, true));
  };
  if (const double seeming = means(single); seeming > 0.0) {
    if (auto of_all = find_mains_hum(frame.t_s, frame.force_N, all)) {
      take_out(*of_all, clean, clean_quality);
      if (means(single_readings(clean, clean_quality, usable)) < kFewMeans * seeming) hum = std::move(of_all);
    }
  }
  take_out(*hum, frame, quality);
  faults.push_back({"hum", frame.t_s.front(), frame.t_s.back(), frame.size(),
                    base::formatted("the force hums with the mains: %.3g N at %.2f Hz%s; taken out", hum->amplitude,
                                    hum->frequency_Hz, hum->steady ? "" : ", wandering")});
}

void report_pressure_clock(const Excitation& excitation, std::vector<DataFault>& faults) {
  if (excitation.pressure_clock_s == 0.0) return;
  const std::string text = base::formatted(
      "the pressure's time stamps are %.3f s (+- %.3f s) %s against the frame's, by its response to "
      "the motion; corrected",
      std::fabs(excitation.pressure_clock_s), excitation.pressure_clock_error_s,
      excitation.pressure_clock_s > 0.0 ? "late" : "early");
  faults.push_back({"clock", excitation.instants.front().t_s, excitation.instants.back().t_s, 0, text});
}

/// Recordings that are explained together count their pressure from one zero: the least of their nominal pressures, so
/// that their order does not matter, unless the model says from where. Nothing where no recording says anything of its
/// pressure.
std::optional<double> count_from_one_pressure(std::vector<Series>& series, std::optional<double> given_psi) {
  const auto says = [](const Excitation& e) {
    return !e.pressure_psi.empty() || e.reference.nominal_pressure_psi != 0.0;
  };
  std::optional<double> from_psi = given_psi;
  for (const Series& each : series)
    if (!given_psi && says(each.excitation))
      from_psi = std::min(from_psi.value_or(HUGE_VAL), each.excitation.reference.nominal_pressure_psi);
  if (!from_psi) return from_psi;
  for (Series& each : series) {
    if (!says(each.excitation)) continue;
    const double shift_psi = each.excitation.reference.nominal_pressure_psi - *from_psi;
    count_pressure_from(each.excitation, *from_psi);
    for (model::Instant& node : each.nodes) node.excess_pressure_psi += shift_psi;
  }
  return from_psi;
}

/// The row of frame.csv at which a session begins whose filling is in its recording: 0 where a diagnosis with `model`
/// would cut nothing off before it.
std::size_t session_begin(const messages::Recording& recording, const RecordingQuality& quality,
                          const model::ModelSpec& model) {
  if (!may_be_cut(recording, quality, model)) return 0;
  messages::Recording session = recording;
  if (!cut_start_up(session) || session.frame.t_s.empty()) return 0;
  return static_cast<std::size_t>(std::ranges::lower_bound(recording.frame.t_s, session.frame.t_s.front()) -
                                  recording.frame.t_s.begin());
}

}  // namespace

void count_as_fitted(Excitation& excitation, const messages::Recording& recording, const RecordingQuality& quality,
                     const model::ModelSpec& model) {
  excitation.begin_row = session_begin(recording, quality, model);
  if (model.pressure_from_psi) count_pressure_from(excitation, *model.pressure_from_psi);
}

void prepare(Study& study, std::vector<messages::Recording> recordings, std::vector<std::string> names,
             model::ModelSpec& nominal) {
  std::vector<Admitted> admitted;
  for (std::size_t i = 0; i < recordings.size(); ++i)
    admitted.push_back(admit(recordings[i], names[i], nominal, study.faults));
  for (std::size_t i = 0; i < recordings.size(); ++i)
    if (!admitted[i].begins_in_a_state && goes_on(recordings[i], recordings))
      add_unknown_state(nominal, admitted[i].id, recordings[i].frame.t_s.front());
  for (std::size_t i = 0; i < recordings.size(); ++i) {
    Guarded guarded = guard_recording(recordings[i], admitted[i].quality);
    study.faults.insert(study.faults.end(), guarded.faults.begin(), guarded.faults.end());
    take_hum_out(recordings[i].frame, admitted[i].quality.force, guarded.usable, study.faults);
    study.series.push_back(
        prepare_series(std::move(names[i]), std::move(recordings[i]), guarded.usable, admitted[i].quality));
    Excitation& excitation = study.series.back().excitation;
    excitation.reference.duration_s = admitted[i].duration_s;
    excitation.reference.recording_id = admitted[i].id;
    study.usable.push_back(std::move(guarded.usable));
    report_pressure_clock(excitation, study.faults);
  }
  give_each_its_zero(study.series, nominal);
  nominal.pressure_from_psi = count_from_one_pressure(study.series, nominal.pressure_from_psi);
  share_noise(study.series);
  study.noise = instrument_noise(study.series, study.usable);
  for (Series& each : study.series) each.noise_reading_s = study.noise.reading_s;
}

}  // namespace isorig::identify
