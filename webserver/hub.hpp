#pragma once
#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/thread_pool.hpp>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "webserver/daemon_link.hpp"
#include "webserver/rules/access.hpp"
#include "webserver/rules/asked_once.hpp"
#include "webserver/rules/history.hpp"
#include "webserver/rules/losses.hpp"
#include "webserver/rules/outbox.hpp"
#include "webserver/rules/saved_protocols.hpp"
#include "webserver/twin/twin_desk.hpp"

namespace isorig::web {

/// One page that looks on.
class Viewer {
 public:
  virtual ~Viewer() = default;
  virtual void send(const std::shared_ptr<const Message>& message) = 0;
  /// Of whom nothing was taken for too long is cut off here.
  virtual void look_after(Time now) = 0;
  /// Empty: without a token, view only.
  [[nodiscard]] virtual const std::string& session() const = 0;
  /// Its page comes back with the cookie that the browser has by then.
  virtual void cut_off() = 0;
};

struct HubSettings {
  std::string socket;                     ///< the daemon's
  std::filesystem::path protocols;        ///< what a run can be started from
  std::filesystem::path saved_protocols;  ///< where the page saves its own; empty: nowhere
  std::filesystem::path specimens;
  std::filesystem::path models;  ///< what a live twin can be made of
};

/// All that the pages have in common: the daemon's samples and answers, who is there, who may do what. Of one thread,
/// but for `access()`.
class Hub {
 public:
  Hub(boost::asio::io_context& io, HubSettings settings);

  void start();

  /// The page gets the history, then what comes.
  void enter(const std::shared_ptr<Viewer>& viewer);
  void leave(const Viewer* viewer);
  [[nodiscard]] std::size_t viewers(bool with_token) const;
  /// Its control is given back, and its pages are cut off.
  void end_session(const std::string& session);

  using Answer = PageAnswer;
  using Reply = PageReply;
  /// A verb of the page: what its session may do is done by the daemon, and logged.
  void perform(const std::string& verb, const std::string& session, const std::string& body, const Reply& reply);
  /// Files a run can be started from.
  void library(const Reply& reply);
  /// What the daemon answers to a GET of the page: runs, calibrations; self-test judged as by `isorig selftest`. Here
  /// and below by the rights of `who`, which the daemon judges.
  void look_up(const std::string& what, const Who& who, const Reply& reply);
  /// A run's own page; its text, or JSON with what is wrong. One at a time: until its answer's `place` is given back,
  /// others are refused with 503.
  void report(const std::string& run, const Who& who, const Reply& reply);
  /// A report by its path on the disk, percent-coded; shares the place of a run's.
  void page(const std::string& path, const Who& who, const Reply& reply);
  /// The protocol that a diagnosis proposes to run next; one question at a time, others are refused with 503.
  void experiment(const std::string& id, const Who& who, const Reply& reply);
  /// A protocol's text with its version: `from` is saved or shipped.
  void protocol(const std::string& from, const std::string& name, const Reply& reply);
  /// Stretches of the raw samples between two times, of all streams, one block behind the other.
  [[nodiscard]] std::string zoom(std::int64_t from_ns, std::int64_t to_ns, std::int64_t stretches) const;

  [[nodiscard]] Access& access() { return access_; }
  [[nodiscard]] const History& history() const { return history_; }

 private:
  void on_record(const daemon::samples::Record& record);
  void on_status(const DaemonAnswer& answer);
  void on_events(const DaemonAnswer& answer);
  void on_plan(const DaemonAnswer& answer);
  void keep_event(const nlohmann::json& event);
  void add_event(const nlohmann::json& event);
  void look_at_twin();
  void look_for(const std::string& what);
  void tick();
  void send_live();
  void broadcast(const std::shared_ptr<const Message>& message);
  void tell_lease();
  [[nodiscard]] std::shared_ptr<const Message> hello_for(const Viewer& viewer);
  [[nodiscard]] std::shared_ptr<const Message> lease_for(const Viewer& viewer) const;
  void change_lease(const std::string& session, const Who& who, const std::string& action, const Reply& reply);
  void change_twin(const Who& who, const nlohmann::json& given, const Reply& reply);
  [[nodiscard]] std::string choose_twin(const std::string& text, TwinDesk::Choice choice);
  void take_note_of_control(const nlohmann::json& control);
  void keep_control(Time now);
  void regain_control();
  /// Texts of the files that a call names; nothing where there is no such file.
  struct Read {
    std::optional<std::string> protocol, specimen;
  };
  void start_run(const Who& who, const nlohmann::json& given, bool preview, const Reply& reply);
  void start_with(const Who& who, const nlohmann::json& given, const Read& read, bool preview, const Reply& reply);
  void note(const Who& who, const nlohmann::json& given, const Reply& reply);
  void twin_of_protocol(const std::string& name, const std::optional<std::string>& text, TwinDesk::OnParting then);
  void take_twin(const Who& who, TwinDesk::Choice choice, const std::string& text, const Reply& reply);
  void forward(const std::string& verb, const Who& who, std::string body, const Reply& reply);
  void check_protocol(const Who& who, const nlohmann::json& given, const Reply& reply);
  void save_protocol(const Who& who, const nlohmann::json& given, const Reply& reply);
  void send_page(const std::string& path, const Who& who, const Reply& reply);
  [[nodiscard]] std::optional<std::string> protocol_text(const std::string& from, const std::string& name) const;
  [[nodiscard]] std::optional<std::string> specimen_text(const std::string& name) const;
  [[nodiscard]] std::optional<std::string> model_text(const std::string& name) const;

  /// Calls `read` in the disk's thread, then `then` with what it gives in that of the io_context, which serves abort: a
  /// disk that hangs keeps nobody from it. `then` is moved on, since a session that ends with its last hold must not
  /// end in the disk's thread.
  template <typename Reading, typename Then>
  void from_disk(Reading read, Then then) {
    boost::asio::post(disk_, [this, read = std::move(read), then = std::move(then)]() mutable {
      auto found = read();
      boost::asio::post(io_, [found = std::move(found), then = std::move(then)]() mutable { then(std::move(found)); });
    });
  }

  boost::asio::io_context& io_;
  const HubSettings settings_;
  Access access_;
  History history_;
  TwinDesk twin_;
  std::string run_;  // that is open
  DaemonLink daemon_;
  boost::asio::steady_timer timer_;

  std::vector<std::shared_ptr<Viewer>> viewers_;
  std::array<std::int64_t, kStreams> sent_until_{};  // fine stretches below this are out
  std::array<std::int64_t, kStreams> coarse_until_{};
  std::array<std::uint32_t, kStreams> restarts_{};
  daemon::samples::Hello hello_;
  daemon::samples::Lost lost_;  // of this connection to the daemon
  Losses losses_;
  std::shared_ptr<const Message> status_, plan_;
  std::deque<nlohmann::json> events_;
  AskedOnce looked_up_;
  std::string runs_now_;                          // what the list of runs depends on
  std::weak_ptr<const void> report_;              // the one that is in memory
  std::weak_ptr<const void> check_, experiment_;  // those that are under way
  const SavedProtocols saved_;
  boost::asio::thread_pool disk_{1};  // what waits for a disk: nobody's abort waits for it
  Time looked_after_{}, kept_{};
  std::int64_t daemon_pid_ = 0;
  std::string holder_before_;     // session that had control when the daemon went
  bool status_is_older_ = false;  // the next one was asked for before the daemon's last word about control
};

}  // namespace isorig::web
