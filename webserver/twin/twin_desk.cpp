#include "webserver/twin/twin_desk.hpp"

#include <cmath>
#include <utility>

#include "base/formatted.hpp"
#include "webserver/rules/files.hpp"

namespace isorig::web {
namespace {

using nlohmann::json;
namespace twin = identify::twin;

/// No motion is known for so long: whatever moved meanwhile, the model did not see it.
constexpr std::int64_t kGap_ns = 1'000'000'000;

}  // namespace

const char* to_text(TwinDesk::OnParting what) {
  return what == TwinDesk::OnParting::kPause ? "pause" : what == TwinDesk::OnParting::kAbort ? "abort" : "mark";
}

std::optional<TwinDesk::OnParting> on_parting_of(const std::string& text) {
  for (const auto what : {TwinDesk::OnParting::kMark, TwinDesk::OnParting::kPause, TwinDesk::OnParting::kAbort})
    if (text == to_text(what)) return what;
  return std::nullopt;
}

void TwinDesk::choose(Choice choice) {
  (void)twin::Twin(choice.spec, {});  // throws for what is wrong with it
  end();
  why_.clear();
  choice_ = std::move(choice);
}

void TwinDesk::put_away(const std::string& why) {
  end();
  choice_.reset();
  why_ = why;
}

void TwinDesk::end() {
  restart();
  session_ = -1;
}

void TwinDesk::restart() {
  twin_.reset();
  moved_ = told_ = false;
  last_.reset();
}

bool TwinDesk::plan(const json& plan) {
  std::vector<Step> steps;
  std::vector<Session> sessions;
  const bool whole = plan.contains("steps") && plan.contains("references");
  for (const auto& s : whole ? plan["steps"] : json::array()) {
    const auto kind = s.value("do", std::string());
    steps.push_back({s["session"].is_number_integer() ? s["session"].get<std::int64_t>() : -1, kind == "pressurize",
                     kind == "ramp" || kind == "wave", s.value("text", std::string())});
  }
  for (const auto& r : whole ? plan["references"] : json::array())
    sessions.push_back({r.value("elongation_at_zero_mm", 0.0), r.value("pressure_psi", 0.0)});
  const auto run = text_at(plan, "run");
  if (run == run_ && steps == steps_ && sessions == sessions_) return false;
  end();
  if (run != run_) overruled_ = false;
  run_ = run;
  steps_ = std::move(steps);
  sessions_ = std::move(sessions);
  return true;
}

void TwinDesk::add(const daemon::PressureRecord& record) {
  if (twin_) twin_->pressure(record.mono_ns, record.pressure_psi);
}

std::vector<twin::Row> TwinDesk::add(const daemon::FrameRecord& record) {
  step_ = record.step;
  if (!choice_ || record.step >= steps_.size()) {
    if (twin_) end();
    return {};
  }
  const Step& step = steps_[record.step];
  if (step.session < 0 || static_cast<std::size_t>(step.session) >= sessions_.size()) {
    end();
    return {};
  }
  const auto passed_ns = record.mono_ns - last_ns_;
  last_ns_ = record.mono_ns;
  if (step.session != session_) {
    end();
    session_ = step.session;
  } else if (twin_ && (passed_ns < -kGap_ns || passed_ns > kGap_ns)) {
    twin_.reset();
    told_ = false;
  }
  if (step.fills) {  // loads the arms, also where the session has moved before
    restart();
    return {};
  }
  if (!twin_) {
    model::Reference reference;
    const Session& session = sessions_[static_cast<std::size_t>(session_)];
    reference.elongation_at_zero_mm = session.elongation_at_zero_mm;
    reference.nominal_pressure_psi = session.pressure_psi;
    twin_ = std::make_unique<twin::Twin>(choice_->spec, reference);
  }
  moved_ = moved_ || step.moves;
  auto rows = twin_->frame({record.mono_ns, record.position_mm, record.force_N, record.step, running_}, moved_);
  if (!twin_->fault().empty()) {
    fault_ = "twin " + choice_->name + " is put away in step " + std::to_string(record.step + 1) + " (" + step.text +
             "): " + twin_->fault();
    put_away(fault_);
    return rows;
  }
  if (!rows.empty()) last_ = rows.back();
  return rows;
}

std::optional<TwinDesk::Found> TwinDesk::take_found() {
  if (told_ || !twin_ || !twin_->parting()) return std::nullopt;
  told_ = true;
  Found out{*twin_->parting(), choice_->name, {}, {}, choice_->on_parting};
  if (out.parting.step < steps_.size()) out.step = steps_[out.parting.step].text;
  const std::string numbers =
      base::formatted("measured minus predicted %+.3g N, found after %.1f s", out.parting.residual_N,
                      1e-9 * static_cast<double>(out.parting.found_mono_ns - out.parting.mono_ns));
  out.text = "twin " + out.model + " and the muscle part in step " + std::to_string(out.parting.step + 1) + " (" +
             out.step + "): " + numbers;
  return out;
}

json TwinDesk::state() const {
  if (!choice_) return {{"model", json()}, {"why", why_}};
  json out{{"model", choice_->name},
           {"on_parting", to_text(choice_->on_parting)},
           {"by_protocol", choice_->by_protocol},
           {"band", choice_->spec.seen.has_value()},
           {"phase", "waits"}};
  if (!twin_) return out;
  const auto& sum = twin_->cusum();
  out["phase"] = twin_->parting() ? "parted" : !moved_ ? "settles" : !running_ ? "stands" : "judged";
  out.update({{"judged", twin_->judged()},
              {"covered", twin_->covered()},
              {"learning", twin_->learning()},
              {"k", sum.design().k},
              {"h", sum.design().h},
              {"correlation_s", -twin::kBlock_s / std::log(sum.design().phi)},
              {"high", sum.high()},
              {"low", sum.low()},
              {"notes", twin_->notes()}});
  if (last_) {
    out["force_N"] = last_->force_N;
    out["half_N"] = last_->half_N;
    out["residual"] = last_->residual;
    out["outside"] = last_->outside;
  }
  if (const auto& parting = twin_->parting()) {
    out["parting"] = {{"mono_ns", parting->mono_ns},
                      {"found_mono_ns", parting->found_mono_ns},
                      {"step", parting->step},
                      {"text", parting->step < steps_.size() ? steps_[parting->step].text : std::string()},
                      {"residual_N", parting->residual_N}};
  }
  return out;
}

}  // namespace isorig::web
