#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "base/number_text.hpp"
#include "c_abi.hpp"
#include "identify/diagnose/forecast.hpp"
#include "identify/diagnose/motion/reconstruction.hpp"
#include "identify/diagnose/prepare.hpp"
#include "isorig_model.h"
#include "messages/recording.hpp"
#include "messages/recording_id.hpp"
#include "rows.hpp"

struct isorig_drive {
  isorig::messages::Recording recording;
  isorig::identify::RecordingQuality quality;
  isorig::identify::Excitation excitation;
};

struct isorig_stepper {
  isorig::model::RunningModel running;
  isorig::model::Reference reference;
  isorig::model::Instant now;
  bool begun = false;
};

namespace {

using namespace isorig;
using c_abi::check_rows, c_abi::guarded, c_abi::require;

thread_local std::string last_notes, last_doubt;

messages::RecordingMetadata metadata_of(const isorig_specimen& specimen) {
  const auto length = [](const char* name, double value) {
    if (!(value > 0.0 && value <= 1e4))
      throw std::invalid_argument(std::string(name) + " is " + base::number_text(value, 6) +
                                  "; it lies between 0 and 10000 mm");
    return value;
  };
  messages::RecordingMetadata metadata;
  metadata.specimen = "specimen";
  if (!std::isnan(specimen.rest_length_mm)) metadata.rest_length_mm = length("rest_length_mm", specimen.rest_length_mm);
  if (!std::isnan(specimen.pressurized_rest_length_mm)) {
    if (!metadata.rest_length_mm)
      throw std::invalid_argument("pressurized_rest_length_mm is stated without rest_length_mm; state both or neither");
    metadata.pressurized_rest_length_mm = length("pressurized_rest_length_mm", specimen.pressurized_rest_length_mm);
  }
  if (!std::isnan(specimen.nominal_pressure_psi)) {
    if (std::fabs(specimen.nominal_pressure_psi) > 1e3)
      throw std::invalid_argument("nominal_pressure_psi is " + base::number_text(specimen.nominal_pressure_psi, 6) +
                                  "; it lies between -1000 and 1000 psi");
    metadata.nominal_pressure_psi = specimen.nominal_pressure_psi;
  }
  return metadata;
}

/// The force is left at zero, as `isorig predict` does: a prediction that had seen it would prove nothing.
messages::Recording recording_of(const isorig_specimen& specimen, std::size_t rows, const double* t_s,
                                 const double* position_mm, std::size_t pressure_rows, const double* pressure_t_s,
                                 const double* pressure_psi) {
  messages::Recording recording;
  recording.metadata = metadata_of(specimen);
  auto& frame = recording.frame;
  frame.t_s.assign(t_s, t_s + rows);
  frame.position_mm.assign(position_mm, position_mm + rows);
  frame.force_N.assign(rows, 0.0);
  if (rows == 0) throw std::invalid_argument("there are no rows");
  check_rows(rows, {"t_s", t_s}, {{"position_mm", position_mm}});
  if (pressure_t_s != nullptr) {
    require(pressure_psi, "pressure_psi");
    auto& gauge = recording.pressure.emplace();
    gauge.t_s.assign(pressure_t_s, pressure_t_s + pressure_rows);
    gauge.pressure_psi.assign(pressure_psi, pressure_psi + pressure_rows);
    check_rows(pressure_rows, {"pressure_t_s", pressure_t_s}, {{"pressure_psi", pressure_psi}});
  }
  return recording;
}

void copy_or_nan(const std::vector<double>& from, std::size_t rows, double* to) {
  if (to == nullptr) return;
  for (std::size_t i = 0; i < rows; ++i) to[i] = from.empty() ? std::numeric_limits<double>::quiet_NaN() : from[i];
}

/// Velocity is that of the interval which ends here, as in the simulated rig (sim/physics.cpp).
model::Instant next_instant(const isorig_stepper& stepper, double t_s, double position_mm, double excess_psi) {
  const model::Instant& before = stepper.now;
  model::Instant now;
  now.t_s = t_s;
  now.position_mm = position_mm;
  now.elongation_mm = position_mm + stepper.reference.elongation_at_zero_mm;
  now.excess_pressure_psi = excess_psi;
  if (!stepper.begun) return now;
  now.dt_s = t_s - before.t_s;
  now.step_mm = position_mm - before.position_mm;
  now.velocity_mm_s = now.step_mm / now.dt_s;
  now.acceleration_mm_s2 = (now.velocity_mm_s - before.velocity_mm_s) / now.dt_s;
  return now;
}

}  // namespace

extern "C" {

const char* isorig_model_notes(void) {
  return last_notes.c_str();
}

isorig_drive* isorig_drive_new(const isorig_specimen* specimen, size_t rows, const double* t_s,
                               const double* position_mm, size_t pressure_rows, const double* pressure_t_s,
                               const double* pressure_psi) {
  return guarded(
      [&] {
        require(specimen, "the specimen");
        require(t_s, "t_s");
        require(position_mm, "position_mm");
        auto recording = recording_of(*specimen, rows, t_s, position_mm, pressure_rows, pressure_t_s, pressure_psi);
        const auto quality = identify::recording_quality(recording);
        auto excitation = identify::reconstruct_excitation(recording, quality);
        return new isorig_drive{std::move(recording), quality, std::move(excitation)};
      },
      nullptr);
}

void isorig_drive_free(isorig_drive* drive) {
  delete drive;
}

int isorig_drive_was_read_with(isorig_drive* drive, const double* force_N) {
  return guarded(
      [&] {
        require(drive, "the drive");
        require(force_N, "force_N");
        messages::Recording read = drive->recording;
        read.frame.force_N.assign(force_N, force_N + read.frame.size());
        drive->excitation.reference.recording_id = messages::recording_id(read);
        return 0;
      },
      -1);
}

int isorig_model_predict(const isorig_model* model, const isorig_drive* drive, double* force_N, double* low95_N,
                         double* high95_N, double* outside) {
  return guarded(
      [&] {
        require(model, "the model");
        require(drive, "the drive");
        require(force_N, "the place for force_N");
        identify::Excitation excitation = drive->excitation;
        identify::count_as_fitted(excitation, drive->recording, drive->quality, model->spec);
        const auto forecast =
            identify::forecast(model->spec, excitation, {}, identify::unread_by(model->spec, drive->recording));
        const std::size_t rows = forecast.force_N.size();
        copy_or_nan(forecast.force_N, rows, force_N);
        copy_or_nan(forecast.low95_N, rows, low95_N);
        copy_or_nan(forecast.high95_N, rows, high95_N);
        copy_or_nan(forecast.outside, rows, outside);
        last_notes.clear();
        for (const std::string& note : forecast.notes) last_notes += note + "\n";
        return 0;
      },
      -1);
}

const char* isorig_unit_in_doubt(const isorig_specimen* specimen, size_t rows, const double* position_mm) {
  return guarded(
      [&]() -> const char* {
        require(specimen, "the specimen");
        require(position_mm, "position_mm");
        messages::FrameSamples frame;
        frame.position_mm.assign(position_mm, position_mm + rows);
        frame.t_s.resize(rows);  // of which only the number of rows matters
        last_doubt = messages::unit_in_doubt(metadata_of(*specimen), frame);
        return last_doubt.c_str();
      },
      nullptr);
}

isorig_stepper* isorig_stepper_new(const isorig_model* model, const isorig_specimen* specimen) {
  return guarded(
      [&] {
        require(model, "the model");
        require(specimen, "the specimen");
        const auto metadata = metadata_of(*specimen);
        const model::Reference reference{.elongation_at_zero_mm = metadata.elongation_at_zero_mm(),
                                         .nominal_pressure_psi = model->spec.pressure_from_psi.value_or(
                                             metadata.nominal_pressure_psi.value_or(0.0))};
        return new isorig_stepper{model::RunningModel(model->spec, reference), reference, {}, false};
      },
      nullptr);
}

void isorig_stepper_free(isorig_stepper* stepper) {
  delete stepper;
}

int isorig_stepper_run(isorig_stepper* stepper, size_t rows, const double* t_s, const double* position_mm,
                       const double* pressure_psi, double* force_N) {
  return guarded(
      [&] {
        require(stepper, "the stepper");
        require(t_s, "t_s");
        require(position_mm, "position_mm");
        require(force_N, "the place for force_N");
        check_rows(rows, {"t_s", t_s}, {{"position_mm", position_mm}, {"pressure_psi", pressure_psi}},
                   stepper->begun ? stepper->now.t_s : -1e300);
        for (std::size_t i = 0; i < rows; ++i) {
          const double excess_psi =
              pressure_psi == nullptr ? 0.0 : pressure_psi[i] - stepper->reference.nominal_pressure_psi;
          const model::Instant now = next_instant(*stepper, t_s[i], position_mm[i], excess_psi);
          if (!stepper->begun) stepper->running.reset(now);
          force_N[i] = stepper->running.step(now);
          stepper->now = now;
          stepper->begun = true;
        }
        return 0;
      },
      -1);
}

}  // extern "C"
