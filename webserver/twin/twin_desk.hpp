#pragma once
#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "daemon/core/records.hpp"
#include "identify/twin/twin.hpp"
#include "webserver/rules/history.hpp"

namespace isorig::web {

/// The live twin of the rig: which model is stepped beside it, in which session, and what is done where the two part.
/// Samples come in as the daemon streams them; nothing here waits, asks for the time or does I/O.
///
/// A twin lives for one session (a repetition at one pressure, what `isorig export` makes one recording of): it begins
/// when the filling is done, is judged from the first step that moves, and ends with the session.
class TwinDesk {
 public:
  enum class OnParting { kMark, kPause, kAbort };

  struct Choice {
    std::string name;  ///< of the model's file
    model::ModelSpec spec;
    OnParting on_parting = OnParting::kMark;
    bool by_protocol = false;
  };
  /// Takes the place of the model there was; it begins where the session stands. Throws std::invalid_argument when the
  /// model's numbers do not belong together.
  void choose(Choice choice);
  void put_away(const std::string& why = {});
  [[nodiscard]] const std::optional<Choice>& choice() const { return choice_; }

  /// The daemon's plan (docs/api.md, GET /v1/plan). False: it is the one there was, which comes again when the daemon
  /// did not answer for once, and the twin goes on.
  bool plan(const nlohmann::json& plan);
  /// A person chose, or put away: what the run that is open asks for counts no more.
  void overrule() { overruled_ = true; }
  [[nodiscard]] bool overruled() const { return overruled_; }

  void add(const daemon::ControlRecord& record) { running_ = record.state == daemon::RunState::kRunning; }
  void add(const daemon::PressureRecord& record);
  /// Rows that are known now, later than the record by up to 0.35 s.
  [[nodiscard]] std::vector<identify::twin::Row> add(const daemon::FrameRecord& record);

  struct Found {
    identify::twin::Parting parting;
    std::string model, step, text;  ///< `text`: a sentence, for log and note
    OnParting on_parting = OnParting::kMark;
  };
  /// A parting that was not taken yet; once.
  [[nodiscard]] std::optional<Found> take_found();
  /// Why the model was put away by itself, since it no longer says a number; once, then empty.
  [[nodiscard]] std::string take_fault() { return std::exchange(fault_, {}); }

  [[nodiscard]] nlohmann::json state() const;
  [[nodiscard]] std::size_t bytes() const { return twin_ ? twin_->bytes() : 0; }

 private:
  struct Step {
    std::int64_t session = -1;
    bool fills = false, moves = false;
    std::string text;
    bool operator==(const Step&) const = default;
  };
  /// What a session's model is referred to.
  struct Session {
    double elongation_at_zero_mm = 0.0, pressure_psi = 0.0;
    bool operator==(const Session&) const = default;
  };
  void end();
  void restart();

  std::optional<Choice> choice_;
  std::string why_;    ///< there is none
  std::string fault_;  // not taken yet
  std::vector<Step> steps_;
  std::vector<Session> sessions_;
  std::string run_;  // whose plan it is
  bool overruled_ = false;
  std::unique_ptr<identify::twin::Twin> twin_;
  std::int64_t session_ = -1;
  std::int64_t last_ns_ = 0;
  std::uint32_t step_ = daemon::kNoStep;
  bool running_ = false;
  bool moved_ = false;
  bool told_ = false;
  std::optional<identify::twin::Row> last_;
};

[[nodiscard]] const char* to_text(TwinDesk::OnParting what);
/// mark, pause or abort; nothing when it is none of them.
[[nodiscard]] std::optional<TwinDesk::OnParting> on_parting_of(const std::string& text);

}  // namespace isorig::web
