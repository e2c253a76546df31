#include "daemon/recording/trip_evidence.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "base/text_file.hpp"
#include "base/utc_text.hpp"
#include "daemon/core/seconds.hpp"
#include "daemon/recording/run_directory.hpp"
#include "daemon/recording/trip_reaction.hpp"

namespace isorig::daemon {
namespace {

using nlohmann::ordered_json;

constexpr const char* kTripFormat = "isorig-trip/1";
constexpr std::size_t kMostEvents = 400;  // of a chain: a fault that comes and goes must not fill the disk

template <typename Record>
void trim(std::deque<Record>& records, std::int64_t before_ns) {
  while (!records.empty() && records.front().mono_ns < before_ns) records.pop_front();
}

/// A number that is none has no JSON.
ordered_json number(double value) {
  return std::isfinite(value) ? ordered_json(value) : ordered_json(nullptr);
}

ordered_json to_json(const EventRecord& e, std::int64_t trip_ns, std::int64_t epoch_unix_us) {
  ordered_json out{{"t_s", seconds(e.mono_ns - trip_ns)},
                   {"code", e.code},
                   {"severity", to_text(e.severity)},
                   {"from", to_text(e.from)},
                   {"to", to_text(e.to)},
                   {"text", e.text},
                   {"value", number(e.value)},
                   {"threshold", number(e.threshold)}};
  if (e.by[0] == '\0') return out;
  out["by"] = e.by;
  if (epoch_unix_us != 0) out["utc"] = base::utc_text((epoch_unix_us + e.mono_ns / 1000) / 1'000'000);
  return out;
}

std::string file_of(int number, const char* what) {
  return "trip-" + std::to_string(number) + what;
}

/// A table's text, line by line.
struct Lines {
  explicit Lines(const char* head) : text(head) {}
  [[gnu::format(printf, 2, 3)]] void add(const char* format, ...) {
    char line[320];
    std::va_list values;
    va_start(values, format);
    const int length = std::vsnprintf(line, sizeof line, format, values);
    va_end(values);
    text.append(line, static_cast<std::size_t>(std::clamp(length, 0, static_cast<int>(sizeof line) - 1)));
  }
  std::string text;
};

std::string text_of(const ordered_json& trip) {
  return trip.dump(1, ' ', false, ordered_json::error_handler_t::replace) + "\n";
}

/// Whole or not at all; its name is on the disk after the next sync_directory(). Throws std::runtime_error.
void replace_file(const std::filesystem::path& directory, const std::string& file, const std::string& text) {
  const auto path = directory / file;
  const auto part = directory / ("." + file + ".part");
  const int fd = ::open(part.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC | O_NOFOLLOW, 0644);
  bool written = fd >= 0;
  for (std::size_t done = 0; written && done < text.size();) {
    const auto n = ::write(fd, text.data() + done, text.size() - done);
    if (n < 0 && errno == EINTR) continue;
    written = n > 0;
    if (written) done += static_cast<std::size_t>(n);
  }
  written = written && ::fsync(fd) == 0;
  int why = errno;
  if (fd >= 0) ::close(fd);
  if (written && ::rename(part.c_str(), path.c_str()) != 0) {
    written = false;
    why = errno;
  }
  if (!written) {
    (void)::unlink(part.c_str());
    throw std::runtime_error("the trip's evidence cannot be written: " + path.string() + ": " + std::strerror(why));
  }
}

/// What of the chain is worth keeping once the samples are written: what ended it.
bool ends_a_trip(const EventRecord& e) {
  const std::string_view code = e.code;
  return e.from != e.to || e.severity >= Severity::kProgramStop || code == "abort" || code == "zero.confirmed";
}

/// Behind it nothing belongs to the trip any more.
bool is_recovery(const EventRecord& e) {
  return e.from != e.to && (e.to == RunState::kRunning || e.to == RunState::kIdle || e.to == RunState::kReady);
}

}  // namespace

TripEvidence::TripEvidence(std::filesystem::path run_dir, std::vector<std::string> step_words,
                           std::int64_t epoch_unix_us)
    : run_dir_(std::move(run_dir)), step_words_(std::move(step_words)), epoch_unix_us_(epoch_unix_us) {
  number_ = first_free(1) - 1;
}

void TripEvidence::take(const FrameRecord& record) {
  frame_.push_back(record);
  if (++frames_taken_ % kTrimEvery == 0) trim(frame_, kept_from(record.mono_ns));
}

void TripEvidence::take(const PressureRecord& record) {
  pressure_.push_back(record);
  if (++pressures_taken_ % kTrimEvery == 0) trim(pressure_, kept_from(record.mono_ns));
}

void TripEvidence::take(const ControlRecord& record) {
  control_.push_back(record);
  trim(control_, kept_from(record.mono_ns));
}

void TripEvidence::take(const EventRecord& record) {
  const bool trips = record.to == RunState::kFaulted && record.from != RunState::kFaulted;
  if (trips) {
    if (!trips_.empty()) {
      trips_.back().end_ns = std::min(trips_.back().end_ns, record.mono_ns);
      trips_.back().is_over = true;
    }
    if (const int free = first_free(number_ + 1); free <= kMostTrips) {
      number_ = free;
      auto& trip = trips_.emplace_back();
      trip.number = free;
      trip.cause = record;
      trip.before = record.from;
      trip.end_ns = record.mono_ns + kAfterNs;
      for (const auto& e : events_) {
        if (e.mono_ns >= record.mono_ns - kBeforeNs) trip.chain.push_back(e);
      }
    }
  }
  if (!trips_.empty() && record.mono_ns >= trips_.back().cause.mono_ns) {
    auto& trip = trips_.back();
    const bool in_time = record.mono_ns < trip.end_ns;
    const bool recovers = !trip.is_over && is_recovery(record);
    if ((in_time || (!trip.is_over && ends_a_trip(record))) && (recovers || trip.chain.size() < kMostEvents)) {
      trip.chain.push_back(record);
      trip.is_stale = true;
    }
    if (recovers && record.to == RunState::kRunning) trip.goes_on_ns = record.mono_ns;
    trip.is_over = trip.is_over || recovers;
  }
  events_.push_back(record);
  trim(events_, record.mono_ns - kBeforeNs);
}

void TripEvidence::advance(std::int64_t mono_ns, bool has_room) {
  while (!trips_.empty()) {
    auto& trip = trips_.front();
    const bool writes = trip.next == File::kNone ? trip.is_stale : mono_ns >= trip.end_ns;
    if (writes) write_next(trip, has_room);
    if (trip.next != File::kNone || !trip.is_over) return;
    trips_.pop_front();
    if (writes) return;
  }
}

void TripEvidence::finish(bool has_room) {
  while (is_owed()) advance(std::numeric_limits<std::int64_t>::max(), has_room);
}

bool TripEvidence::is_owed() const noexcept {
  return std::any_of(trips_.begin(), trips_.end(), [](const Trip& t) { return t.next != File::kNone || t.is_stale; });
}

std::int64_t TripEvidence::kept_from(std::int64_t now_ns) const noexcept {
  const auto owed = std::find_if(trips_.begin(), trips_.end(), [](const Trip& t) { return t.next < File::kStory; });
  return (owed == trips_.end() ? now_ns : std::min(now_ns, owed->cause.mono_ns)) - kBeforeNs;
}

int TripEvidence::first_free(int number) const {
  std::error_code ignored;
  while (number <= kMostTrips && std::filesystem::exists(run_dir_ / file_of(number, ".json"), ignored)) ++number;
  return number;
}

void TripEvidence::write_next(Trip& trip, bool has_room) {
  if (trip.next == File::kFrame) {
    error_.clear();
    const auto at = first_from(control_, trip.cause.mono_ns);
    if (at != control_.begin()) trip.at = *(at - 1);
    // What a run does that goes on is no reaction.
    trip.reaction =
        trip_reaction(frame_, pressure_, control_, trip.cause.mono_ns, std::min(trip.end_ns, trip.goes_on_ns));
  }
  if (trip.next < File::kStory && !has_room) {
    if (error_.empty()) {
      error_ = "the disk has no room for the samples of " + file_of(trip.number, ".json") +
               "; the recording holds them as far as it took them";
    }
    trip.next = File::kStory;
  }
  if (trip.next < File::kStory) {
    write_samples(trip);
    trip.next = static_cast<File>(static_cast<int>(trip.next) + 1);
    return;
  }
  write_story(trip);
  trip.next = File::kNone;
  trip.is_stale = false;
}

void TripEvidence::write_samples(Trip& trip) {
  const bool frame = trip.next == File::kFrame, pressure = trip.next == File::kPressure;
  const auto file = file_of(trip.number, frame ? "-frame.csv" : pressure ? "-pressure.csv" : "-control.csv");
  if (write_file(file, frame ? frame_csv(trip) : pressure ? pressure_csv(trip) : control_csv(trip))) {
    trip.files.push_back(file);
  }
}

std::string TripEvidence::frame_csv(const Trip& trip) const {
  const std::int64_t trip_ns = trip.cause.mono_ns;
  Lines out("t_s,mono_ns,bound_ns,device_us,sequence,step,raw_position_mm,raw_force_N,position_mm,force_N\n");
  const auto end = first_from(frame_, trip.end_ns);
  for (auto r = first_from(frame_, trip_ns - kBeforeNs); r < end; ++r) {
    out.add("%.6f,%lld,%.0f,%lld,%u,%d,%.9g,%.9g,%.9g,%.9g\n", seconds(r->mono_ns - trip_ns),
            static_cast<long long>(r->mono_ns), double{r->bound_ns}, static_cast<long long>(r->device_us), r->sequence,
            static_cast<int>(r->step), double{r->raw_position_mm}, double{r->raw_force_N}, r->position_mm, r->force_N);
  }
  return std::move(out.text);
}

std::string TripEvidence::pressure_csv(const Trip& trip) const {
  const std::int64_t trip_ns = trip.cause.mono_ns;
  Lines out("t_s,mono_ns,bound_ns,device_us,sequence,step,raw_word,status,pressure_psi,temperature_C\n");
  const auto end = first_from(pressure_, trip.end_ns);
  for (auto r = first_from(pressure_, trip_ns - kBeforeNs); r < end; ++r) {
    out.add("%.6f,%lld,%.0f,%lld,%u,%d,%u,%d,%.9g,%.9g\n", seconds(r->mono_ns - trip_ns),
            static_cast<long long>(r->mono_ns), double{r->bound_ns}, static_cast<long long>(r->device_us), r->sequence,
            static_cast<int>(r->step), r->raw_word, static_cast<int>(r->status), r->pressure_psi,
            double{r->temperature_C});
  }
  return std::move(out.text);
}

std::string TripEvidence::control_csv(const Trip& trip) const {
  const std::int64_t trip_ns = trip.cause.mono_ns;
  Lines out(
      "t_s,mono_ns,state,step,setpoint_psi,pressure_psi,fill_permille,vent_permille,target_mm,velocity_mm_s,"
      "position_mm,force_N,worst_wakeup_ns,worst_run_ns\n");
  const auto end = first_from(control_, trip.end_ns);
  for (auto r = first_from(control_, trip_ns - kBeforeNs); r < end; ++r) {
    out.add("%.6f,%lld,%s,%d,%.9g,%.9g,%d,%d,%.9g,%.9g,%.9g,%.9g,%u,%u\n", seconds(r->mono_ns - trip_ns),
            static_cast<long long>(r->mono_ns), to_text(r->state), static_cast<int>(r->step), double{r->setpoint_psi},
            double{r->pressure_psi}, int{r->fill_permille}, int{r->vent_permille}, double{r->target_mm},
            double{r->velocity_mm_s}, double{r->position_mm}, double{r->force_N}, r->worst_wakeup_ns, r->worst_run_ns);
  }
  return std::move(out.text);
}

void TripEvidence::write_story(const Trip& t) {
  const std::int64_t trip_ns = t.cause.mono_ns;
  ordered_json out{{"format", kTripFormat},
                   {"number", t.number},
                   {"mono_ns", trip_ns},
                   {"code", t.cause.code},
                   {"severity", to_text(t.cause.severity)},
                   {"text", t.cause.text},
                   {"value", number(t.cause.value)},
                   {"threshold", number(t.cause.threshold)},
                   {"state", to_text(t.before)},
                   {"step", t.cause.step == kNoStep ? -1 : static_cast<std::int64_t>(t.cause.step)}};
  if (t.cause.step < step_words_.size()) out["step_words"] = step_words_[t.cause.step];
  if (t.at) {
    out["before"] = {{"position_mm", number(double{t.at->position_mm})},
                     {"force_N", number(double{t.at->force_N})},
                     {"pressure_psi", number(double{t.at->pressure_psi})},
                     {"setpoint_psi", number(double{t.at->setpoint_psi})}};
  }
  out["reaction"] = t.reaction;
  out["events"] = ordered_json::array();
  for (const auto& e : t.chain) out["events"].push_back(to_json(e, trip_ns, epoch_unix_us_));
  out["files"] = t.files;
  write_file(file_of(t.number, ".json"), text_of(out));
  sync_directory(run_dir_);
}

bool TripEvidence::write_file(const std::string& file, const std::string& text) {
  try {
    replace_file(run_dir_, file, text);
    return true;
  } catch (const std::exception& e) {
    if (error_.empty()) error_ = e.what();
    return false;
  }
}

void append_to_last_trip(const std::filesystem::path& run_dir, const EventRecord& event, std::int64_t epoch_unix_us) {
  std::error_code ignored;
  int last = 0;
  while (std::filesystem::exists(run_dir / file_of(last + 1, ".json"), ignored)) ++last;
  if (last == 0) return;
  const std::string file = file_of(last, ".json");
  try {
    auto trip = ordered_json::parse(base::read_text_file(run_dir / file));
    if (const auto format = trip.at("format").get<std::string>(); format != kTripFormat) {
      throw std::runtime_error((run_dir / file).string() + " is left as it is: its format is \"" + format +
                               "\", and this program knows \"" + kTripFormat + "\"");
    }
    const auto trip_ns = trip.at("mono_ns").get<std::int64_t>();
    for (const auto& e : trip.at("events")) {
      const auto& code = e.at("code");
      const bool ends = code == "reset" || code == "run.aborted" || code == "run.failed";
      if (ends && e.at("t_s").get<double>() > 0.0) return;
    }
    trip.at("events").push_back(to_json(event, trip_ns, epoch_unix_us));
    replace_file(run_dir, file, text_of(trip));
    sync_directory(run_dir);
  } catch (const ordered_json::exception& e) {
    throw std::runtime_error((run_dir / file).string() + " is no evidence of a trip: " + e.what());
  }
}

}  // namespace isorig::daemon
