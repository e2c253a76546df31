#include "webserver/hub.hpp"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>
#include <utility>

#include "webserver/rules/files.hpp"
#include "webserver/words/verdicts.hpp"

namespace isorig::web {
namespace {

using nlohmann::json;

constexpr auto kTick = std::chrono::milliseconds(50);
constexpr std::size_t kEventsKept = 1000;
/// Of the history, one message: about 100 kB.
constexpr std::int64_t kStretchesAtOnce = 3000;
/// Sent first after a reload: what the page opens with.
constexpr std::int64_t kFirst_ns = 60'000'000'000;

/// For the age of a status alone: a clock that is set makes none old (web/src/live/sent_clock.ts).
std::int64_t steady_ms() {
  return std::chrono::duration_cast<std::chrono::milliseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

std::int64_t unix_ms() {
  return std::chrono::duration_cast<std::chrono::milliseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

using Kind = Message::Kind;
std::shared_ptr<const Message> message(Kind kind, std::string bytes) {
  return std::make_shared<const Message>(Message{std::move(bytes), kind});
}
std::shared_ptr<const Message> message(Kind kind, const json& body) {
  return message(kind, body.dump(-1, ' ', false, json::error_handler_t::replace));
}

constexpr std::array kAllStreams{Stream::kFrame, Stream::kPressure, Stream::kControl, Stream::kBand, Stream::kTwin};
std::size_t number_of(Stream stream) {
  return static_cast<std::size_t>(stream);
}

}  // namespace

Hub::Hub(boost::asio::io_context& io, HubSettings settings)
    : io_(io),
      settings_(std::move(settings)),
      daemon_(
          io, settings_.socket,
          {[this](const daemon::samples::Record& r) { on_record(r); }, [this](const DaemonAnswer& a) { on_status(a); },
           [this](const DaemonAnswer& a) { on_events(a); }, [this](const DaemonAnswer& a) { on_plan(a); },
           [](const std::string& text) { spdlog::info("{}", text); }}),
      timer_(io),
      looked_up_([this](const std::string& what) { look_for(what); }),
      saved_(settings_.saved_protocols) {}

void Hub::start() {
  daemon_.start();
  tick();
}

void Hub::on_record(const daemon::samples::Record& record) {
  if (const auto* hello = std::get_if<daemon::samples::Hello>(&record)) {
    hello_ = *hello;
    losses_.connected();
    lost_ = {};
    for (const auto& v : viewers_) v->send(hello_for(*v));
  } else if (const auto* frame = std::get_if<daemon::FrameRecord>(&record)) {
    history_.add(*frame);
    for (const auto& row : twin_.add(*frame)) {
      history_.add_twin(row.mono_ns, row.force_N, row.half_N, row.residual);
    }
    look_at_twin();
  } else if (const auto* pressure = std::get_if<daemon::PressureRecord>(&record)) {
    history_.add(*pressure);
    twin_.add(*pressure);
  } else if (const auto* control = std::get_if<daemon::ControlRecord>(&record)) {
    history_.add(*control);
    twin_.add(*control);
  } else if (const auto* lost = std::get_if<daemon::samples::Lost>(&record)) {
    if (lost->frame + lost->pressure > lost_.frame + lost_.pressure) {
      spdlog::warn("samples: {} of the frame and {} of the pressure were lost on the way here; the recording has them",
                   lost->frame, lost->pressure);
    }
    lost_ = *lost;
    losses_.told({lost->frame + lost->pressure, lost->control + lost->events, lost->before_the_socket});
    return;
  }
  if (!std::holds_alternative<daemon::samples::Hello>(record)) losses_.record();
}

void Hub::on_status(const DaemonAnswer& answer) {
  const json web{{"unix_ms", unix_ms()},
                 {"sent_ms", steady_ms()},
                 {"lost", losses_.all(history_.gaps())},
                 {"lost_on_the_way", losses_.on_the_way()},
                 {"lateness", history_.lateness().counts()},
                 {"verdicts", answer.status == 200 ? verdicts_of(answer.body) : json::object()},
                 {"twin", twin_.state()},
                 {"viewers", viewers_.size()}};
  if (answer.status == 200) {
    const auto part = [&](const char* key) { return answer.body.value(key, json()); };
    const auto run = part("run"), last = part("last_run");
    const auto pid = answer.body.value("pid", std::int64_t{0});
    const bool another = std::exchange(daemon_pid_, pid) != pid;  // it may be there again before it was missed
    if (const auto session = access_.present_holder(); another && session) holder_before_ = *session;
    if (!std::exchange(status_is_older_, false) || another) take_note_of_control(part("control"));
    regain_control();
    std::string now = run.is_object() ? text_at(run, "id") : std::string();
    if (last.is_object()) now += " " + text_at(last, "id") + " " + text_at(last, "outcome");
    if (now != runs_now_) looked_up_.forget();
    runs_now_ = std::move(now);
    status_ = message(Kind::kStatus, "{\"kind\":\"status\",\"web\":" + web.dump() + ",\"status\":" + answer.text + "}");
  } else {
    status_ = message(Kind::kStatus, {{"kind", "status"},
                                      {"web", web},
                                      {"status", json()},
                                      {"why", text_at(answer.body, "text")},
                                      {"none", answer.status == 0 ? answer.none : "refused"}});
    plan_.reset();
    if (const auto session = access_.present_holder()) holder_before_ = *session;
    take_note_of_control(json());
    // The daemon tells its own again.
    std::erase_if(events_, [](const json& e) { return e.value("code", "") != "twin"; });
  }
  broadcast(status_);
}

void Hub::on_events(const DaemonAnswer& answer) {
  for (const auto& e : answer.body["events"]) keep_event(e);
  broadcast(message(Kind::kEvents, "{\"kind\":\"events\",\"events\":" + answer.body["events"].dump() + "}"));
}

void Hub::add_event(const json& event) {
  keep_event(event);
  broadcast(message(Kind::kEvents, {{"kind", "events"}, {"events", json::array({event})}}));
}

void Hub::keep_event(const json& event) {
  // One that has grown comes again with another number.
  std::erase_if(events_, [&](const json& old) {
    return old.value("mono_ns", std::int64_t{0}) == event.value("mono_ns", std::int64_t{0}) &&
           old.value("code", "") == event.value("code", "");
  });
  events_.push_back(event);
  while (events_.size() > kEventsKept) events_.pop_front();
}

void Hub::tick() {
  timer_.expires_after(kTick);
  timer_.async_wait([this](boost::system::error_code stopped) {
    if (!stopped) tick();
  });
  send_live();
  const auto now = std::chrono::steady_clock::now();
  if (now - looked_after_ < std::chrono::seconds(1)) return;
  looked_after_ = now;
  const auto all = viewers_;  // one that is cut off leaves the list
  for (const auto& v : all) v->look_after(now);
  access_.expire(now);
  keep_control(now);
}

void Hub::send_live() {
  for (const auto stream : kAllStreams) {
    const auto n = number_of(stream);
    const auto& series = history_.series(stream);
    const auto newest = series.newest_ns();
    if (!newest) continue;
    const auto open = *newest / kFineWidth_ns;
    if (series.restarts() != restarts_[n] || sent_until_[n] == 0) {
      restarts_[n] = series.restarts();
      sent_until_[n] = open;
      coarse_until_[n] = series.coarse_open();
      if (series.restarts() > 0) broadcast(message(Kind::kAnotherClock, json{{"kind", "another-clock"}}));
      continue;
    }
    if (open > sent_until_[n]) {
      const auto fresh = series.stretches(kFineWidth_ns, sent_until_[n], open);
      sent_until_[n] = open;
      if (!viewers_.empty() && !fresh.empty()) {
        broadcast(message(Kind::kSamples, block(stream, 0, kFineWidth_ns, fresh)));
      }
    }
    if (series.coarse_open() > coarse_until_[n]) {
      const auto fresh = series.coarse(coarse_until_[n]);
      coarse_until_[n] = series.coarse_open();
      if (!viewers_.empty() && !fresh.empty()) {
        broadcast(message(Kind::kSamples, block(stream, 1, kCoarseWidth_ns, fresh)));
      }
    }
  }
}

void Hub::enter(const std::shared_ptr<Viewer>& viewer) {
  viewers_.push_back(viewer);
  viewer->send(hello_for(*viewer));
  viewer->send(lease_for(*viewer));
  if (status_) viewer->send(status_);
  if (plan_) viewer->send(plan_);
  const auto backfill = [&](Stream stream, std::int64_t from, std::int64_t to) {
    for (auto at = from; at < to; at += kStretchesAtOnce) {
      const auto part = history_.series(stream).stretches(kFineWidth_ns, at, std::min(to, at + kStretchesAtOnce));
      if (part.empty()) continue;
      viewer->send(message(Kind::kSamples, block(stream, 0, kFineWidth_ns, part)));
    }
  };
  constexpr auto kFirst = kFirst_ns / kFineWidth_ns;
  for (const auto stream : kAllStreams) {
    const auto until = sent_until_[number_of(stream)];
    backfill(stream, until - kFirst, until);
  }
  viewer->send(message(Kind::kEvents, {{"kind", "events"}, {"events", events_}}));
  for (const auto stream : kAllStreams) {
    const auto& series = history_.series(stream);
    const auto until = sent_until_[number_of(stream)];
    backfill(stream, until - kFineKept_ns / kFineWidth_ns, until - kFirst);
    const auto day = series.coarse(INT64_MIN);
    if (!day.empty()) {
      viewer->send(message(Kind::kSamples, block(stream, 1, kCoarseWidth_ns, day)));
    }
  }
}

void Hub::leave(const Viewer* viewer) {
  std::erase_if(viewers_, [&](const auto& v) { return v.get() == viewer; });
}

std::size_t Hub::viewers(bool with_token) const {
  return static_cast<std::size_t>(std::count_if(viewers_.begin(), viewers_.end(),
                                                [&](const auto& v) { return v->session().empty() != with_token; }));
}

void Hub::broadcast(const std::shared_ptr<const Message>& message) {
  const auto all = viewers_;  // one that is cut off leaves the list
  for (const auto& v : all) v->send(message);
}

void Hub::tell_lease() {
  for (const auto& v : viewers_) v->send(lease_for(*v));
}

std::shared_ptr<const Message> Hub::hello_for(const Viewer& viewer) {
  const auto who = access_.who(viewer.session(), std::chrono::steady_clock::now());
  return message(Kind::kHello, {{"kind", "hello"},
                                {"rig", hello_.rig},
                                {"epoch_unix_us", hello_.epoch_unix_us},
                                {"fine_ns", kFineWidth_ns},
                                {"fine_kept_ns", kFineKept_ns},
                                {"coarse_ns", kCoarseWidth_ns},
                                {"may_control", who.has_value()},
                                {"name", who ? who->name : ""}});
}

std::shared_ptr<const Message> Hub::lease_for(const Viewer& viewer) const {
  const auto control = access_.control();
  return message(Kind::kLease, {{"kind", "lease"},
                                {"holder", control ? json(control->holder) : json()},
                                {"mine", access_.has_control(viewer.session())}});
}

std::string Hub::zoom(std::int64_t from_ns, std::int64_t to_ns, std::int64_t stretches) const {
  const auto width = std::max<std::int64_t>(1'000'000, (to_ns - from_ns) / std::max<std::int64_t>(1, stretches));
  std::string out;
  for (const auto stream : kAllStreams) {
    out += block(stream, 2, width, history_.series(stream).stretches(width, from_ns / width, to_ns / width + 1));
  }
  return out;
}

}  // namespace isorig::web
