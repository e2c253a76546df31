#pragma once
#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "webserver/access.hpp"
#include "webserver/daemon_link.hpp"
#include "webserver/history.hpp"

namespace isorig::web {

/// What is sent over a WebSocket; shared by all who get it.
struct Message {
  std::string bytes;
  bool binary = false;
};

/// One page that looks on.
class Viewer {
 public:
  virtual ~Viewer() = default;
  virtual void send(const std::shared_ptr<const Message>& message) = 0;
  /// Of whom nothing was taken for too long is cut off here.
  virtual void look_after(Time now) = 0;
  /// Empty: without a token, view only.
  [[nodiscard]] virtual const std::string& session() const = 0;
};

struct HubSettings {
  std::string socket;               ///< the daemon's
  std::filesystem::path protocols;  ///< what a run can be started from
  std::filesystem::path specimens;
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

  /// The answer to a POST: `text` is JSON.
  struct Answer {
    int status = 0;
    std::string text;
  };
  using Reply = std::function<void(Answer)>;
  /// A verb of the page: what its session may do is done by the daemon, and logged.
  void perform(const std::string& verb, const std::string& session, const std::string& body, const Reply& reply);
  /// Files a run can be started from.
  [[nodiscard]] std::string library() const;
  /// Stretches of the raw samples between two times, of all streams, one block behind the other.
  [[nodiscard]] std::string zoom(std::int64_t from_ns, std::int64_t to_ns, std::int64_t stretches) const;

  [[nodiscard]] Access& access() { return access_; }
  [[nodiscard]] const History& history() const { return history_; }

 private:
  void on_record(const daemon::samples::Record& record);
  void on_status(const DaemonAnswer& answer);
  void on_events(const DaemonAnswer& answer);
  void tick();
  void send_live();
  void broadcast(const std::shared_ptr<const Message>& message);
  void tell_lease();
  [[nodiscard]] std::shared_ptr<const Message> hello_for(const Viewer& viewer);
  [[nodiscard]] std::shared_ptr<const Message> lease_for(const Viewer& viewer) const;
  void change_lease(const std::string& session, const Who& who, const std::string& action, const Reply& reply);
  void start_run(const Who& who, const nlohmann::json& given, bool preview, const Reply& reply);
  void forward(const std::string& verb, const Who& who, std::string body, const Reply& reply);
  [[nodiscard]] std::vector<std::string> files(const std::filesystem::path& folder) const;

  boost::asio::io_context& io_;
  const HubSettings settings_;
  Access access_;
  History history_;
  DaemonLink daemon_;
  boost::asio::steady_timer timer_;

  std::vector<std::shared_ptr<Viewer>> viewers_;
  std::array<std::int64_t, kStreams> sent_until_{};  // fine stretches below this are out
  std::array<std::int64_t, kStreams> coarse_until_{};
  std::array<std::uint32_t, kStreams> restarts_{};
  daemon::samples::Hello hello_;
  daemon::samples::Lost lost_;     // of this connection to the daemon
  std::uint64_t lost_before_ = 0;  // of those that ended
  std::shared_ptr<const Message> status_, plan_;
  std::deque<nlohmann::json> events_;
  Time looked_after_{};
};

}  // namespace isorig::web
