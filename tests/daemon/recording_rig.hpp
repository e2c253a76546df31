#pragma once
#include <unistd.h>

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "daemon/core/streams.hpp"
#include "daemon/recording/recorder.hpp"
#include "messages/crc32c.hpp"
#include "messages/log_event.hpp"
#include "messages/run_log.hpp"

/// A source of records whose every value follows from its index, and a reader that collects what came back.
namespace isorig::daemon::testing {

class TemporaryDirectory {
 public:
  explicit TemporaryDirectory(const std::string& name, const std::filesystem::path& under = "/tmp") {
    auto pattern = (under / ("isorig-" + name + "-XXXXXX")).string();
    path_ = ::mkdtemp(pattern.data());
  }
  ~TemporaryDirectory() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TemporaryDirectory(const TemporaryDirectory&) = delete;
  TemporaryDirectory& operator=(const TemporaryDirectory&) = delete;
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

inline constexpr std::int64_t kMs = 1'000'000;

/// Irrational steps, so that no two samples are equal and averages are not accidentally right.
inline FrameRecord frame_record(std::int64_t i, std::uint32_t step, Keep keep) {
  FrameRecord r;
  r.mono_ns = i * kMs + 137;
  r.device_us = 5'000'000'000 + i * 1000 + i / 33'000;
  r.sequence = static_cast<std::uint32_t>(0xffff'ff00U + static_cast<std::uint64_t>(i));  // wraps on the way
  r.step = step;
  r.bound_ns = 150'000.0F + static_cast<float>(i % 97);
  r.repeatability_ns = 9'000.0F + static_cast<float>(i % 89);
  r.raw_position_mm = static_cast<float>(std::sin(0.001 * static_cast<double>(i)));
  r.raw_force_N = static_cast<float>(std::cos(0.003 * static_cast<double>(i)));
  r.position_mm = 2.0 * std::sin(0.001 * static_cast<double>(i));
  r.force_N = 30.0 * std::cos(0.003 * static_cast<double>(i));
  r.keep = keep;
  return r;
}

inline PressureRecord pressure_record(std::int64_t i, std::uint32_t step, Keep keep) {
  PressureRecord r;
  r.mono_ns = i * kMs + 500'211;
  r.device_us = 77 + i * 1000;
  r.sequence = static_cast<std::uint32_t>(i);
  r.step = step;
  r.bound_ns = 40'000.0F;
  r.repeatability_ns = 7'000.0F;
  r.raw_word = (1638U + static_cast<std::uint32_t>(i % 13000)) << 16U | 0xABC0U;
  r.status = static_cast<std::uint8_t>(i % 1000 == 999 ? 2 : 0);
  r.keep = keep;
  r.temperature_C = 21.5F;
  r.pressure_psi = 15.0 + 0.01 * std::sin(0.0007 * static_cast<double>(i));
  return r;
}

inline ControlRecord control_record(std::int64_t i, std::uint32_t step) {
  ControlRecord r;
  r.mono_ns = i * kMs;
  r.step = step;
  r.state = RunState::kRunning;
  r.setpoint_psi = 15.0F;
  r.ticks = static_cast<std::uint64_t>(i);
  r.worst_wakeup_ns = i % 5000 == 0 ? 90'000 : 4'000;
  r.worst_run_ns = 2'000;
  r.progress = static_cast<float>(i) * 1e-6F;
  return r;
}

inline ExchangeRecord exchange_record(std::int64_t i, DeviceId device) {
  ExchangeRecord r;
  r.device = device;
  r.exchange.host_send_ns = i * kMs - 300'000;
  r.exchange.host_recv_ns = i * kMs;
  r.exchange.device_rx_us = static_cast<double>(i) * 1000.0 + 0.25;
  r.exchange.device_tx_us = r.exchange.device_rx_us + 20.0;
  return r;
}

inline EventRecord event_record(std::int64_t i, std::uint32_t step, const char* code, Severity severity) {
  EventRecord r;
  r.mono_ns = i * kMs + 1;
  r.step = step;
  r.severity = severity;
  r.from = RunState::kRunning;
  r.to = severity >= Severity::kProgramStop ? RunState::kStopping : RunState::kRunning;
  std::snprintf(r.code, sizeof r.code, "%s", code);
  std::snprintf(r.text, sizeof r.text, "at sample %lld", static_cast<long long>(i));
  r.value = static_cast<double>(i);
  return r;
}

/// What the plan does at a millisecond.
struct Stretch {
  std::int64_t until_ms;
  std::uint32_t step;
  Keep keep;
};

/// Pushes the millisecond `i`: a sample of each stream, control at 100 Hz, exchanges at 2 Hz.
inline void push_ms(Streams& streams, std::int64_t i, const Stretch& s) {
  streams.frame.push(frame_record(i, s.step, s.keep));
  streams.pressure.push(pressure_record(i, s.step, s.keep));
  if (i % 10 == 0) streams.control.push(control_record(i, s.step));
  if (i % 500 == 0) {
    streams.exchanges.push(exchange_record(i, DeviceId::kFrame));
    streams.exchanges.push(exchange_record(i, DeviceId::kPressure));
  }
}

/// A run of `plan`, with a drain every `drain_every_ms`.
inline void run_plan(Recorder& recorder, Streams& streams, const std::vector<Stretch>& plan,
                     std::int64_t drain_every_ms, std::int64_t from_ms = 0) {
  std::int64_t i = from_ms;
  for (const auto& stretch : plan) {
    streams.events.push(event_record(i, stretch.step, "step", Severity::kInfo));
    for (; i < stretch.until_ms; ++i) {
      push_ms(streams, i, stretch);
      if (i % drain_every_ms == 0) recorder.drain(streams, i * kMs);
    }
  }
}

inline RunInfo run_info() {
  RunInfo info;
  info.epoch_unix_us = 946'684'800'000'000;
  info.virtual_time = true;
  info.seed = 42;
  info.rig = "test rig";
  info.specimen = "M1";
  info.rest_length_mm = 120.5;
  info.plan_summary = "a plan";
  info.texts = {{"protocol.toml", "# protocol\n"}, {"rig.toml", "# rig\n"}};
  info.versions = {{"isorig", "0.1.0"}};
  info.run_id = "test";
  info.started_utc = "2000-01-01T00:00:00Z";
  return info;
}

inline RecorderOptions recorder_options(const std::filesystem::path& run_dir) {
  RecorderOptions o;
  o.run_dir = run_dir;
  o.min_free_bytes = 1U << 20U;
  o.reserve_bytes = 1U << 20U;
  o.free_bytes = [](const std::filesystem::path&) { return std::uint64_t{1} << 40U; };
  return o;
}

/// Everything that a run's directory holds, flattened.
struct Collected : messages::RunVisitor {
  struct Sample {
    std::int64_t mono_ns;
    std::int64_t device_us;
    std::int64_t sequence;
    std::int32_t session;
    std::int32_t step;
    double value;  // position or pressure
    double other;  // force or raw word
  };
  struct Interval {
    std::int64_t first_ns;
    std::int64_t last_ns;
    std::int64_t first_sequence;
    std::int64_t last_sequence;
    std::int32_t session;
    std::int32_t step;
    int samples;
    double mean, min, max;  // position or pressure
  };

  void segment(const std::filesystem::path& path) override { segments.push_back(path.filename()); }
  void header(const isorig_msgs::run_header_t& h) override { headers.push_back(h); }
  void session(const isorig_msgs::session_mark_t& m) override { marks.push_back(m); }
  void frame(const isorig_msgs::frame_batch_t& m) override {
    frame_batches.push_back(m);
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
      frames.push_back({m.mono_ns + m.mono_offset_ns[i], m.device_us + m.device_offset_us[i],
                        m.sequence + m.sequence_offset[i], m.session, m.step, m.position_mm[i], m.force_N[i]});
    }
  }
  void pressure(const isorig_msgs::pressure_batch_t& m) override {
    pressure_batches.push_back(m);
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
      pressures.push_back({m.mono_ns + m.mono_offset_ns[i], m.device_us + m.device_offset_us[i],
                           m.sequence + m.sequence_offset[i], m.session, m.step, m.pressure_psi[i],
                           static_cast<double>(static_cast<std::uint32_t>(m.raw_word[i]))});
    }
  }
  void frame_average(const isorig_msgs::frame_average_batch_t& m) override {
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
      frame_intervals.push_back({m.first_mono_ns[i], m.last_mono_ns[i], m.first_sequence[i], m.last_sequence[i],
                                 m.session, m.step, m.samples[i], m.mean_position_mm[i], m.min_position_mm[i],
                                 m.max_position_mm[i]});
    }
  }
  void pressure_average(const isorig_msgs::pressure_average_batch_t& m) override {
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
      pressure_intervals.push_back({m.first_mono_ns[i], m.last_mono_ns[i], m.first_sequence[i], m.last_sequence[i],
                                    m.session, m.step, m.samples[i], m.mean_pressure_psi[i], m.min_pressure_psi[i],
                                    m.max_pressure_psi[i]});
    }
  }
  void control(const isorig_msgs::control_batch_t& m) override {
    controls.insert(controls.end(), m.samples.begin(), m.samples.begin() + m.count);
  }
  void event(const isorig_msgs::event_t& m) override { events.push_back(m); }
  void exchanges(const isorig_msgs::exchange_batch_t& m) override {
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
      exchange.push_back({static_cast<DeviceId>(m.device[i]),
                          {m.host_send_ns[i], m.host_recv_ns[i], m.device_rx_us[i], m.device_tx_us[i]}});
    }
  }

  std::vector<std::string> segments;
  std::vector<isorig_msgs::run_header_t> headers;
  std::vector<isorig_msgs::session_mark_t> marks;
  std::vector<isorig_msgs::frame_batch_t> frame_batches;
  std::vector<isorig_msgs::pressure_batch_t> pressure_batches;
  std::vector<Sample> frames;
  std::vector<Sample> pressures;
  std::vector<Interval> frame_intervals;
  std::vector<Interval> pressure_intervals;
  std::vector<isorig_msgs::control_t> controls;
  std::vector<isorig_msgs::event_t> events;
  std::vector<ExchangeRecord> exchange;
};

inline std::string file_text(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// Makes a segment one of a version to come, with a checksum that fits.
inline void make_version_3(const std::filesystem::path& segment) {
  auto log = file_text(segment);
  const auto version = log.find("isorig-log/2");
  if (version == std::string::npos) throw std::logic_error(segment.string() + " is no recording");
  log[version + 11] = '3';
  auto* bytes = reinterpret_cast<std::uint8_t*>(log.data());
  const auto checked = static_cast<std::size_t>(messages::kLogHeaderBytes + messages::big_endian(bytes + 20, 4) +
                                                messages::big_endian(bytes + 24, 4) - messages::kLogChecksumBytes);
  messages::put_big_endian(bytes + checked, messages::crc32c({bytes, checked}));
  std::ofstream(segment, std::ios::binary) << log;
}

}  // namespace isorig::daemon::testing
