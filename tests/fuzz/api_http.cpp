// The control API from its socket on: bytes of a connection, before a host on a simulated rig that is ready.
// First byte: 1 the socket of the stops; 2 a whole request: its first line, a line of "%%%%", its body.
#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cstring>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "answers.hpp"
#include "daemon/host/api.hpp"
#include "daemon/host/host.hpp"
#include "daemon/rig/virtual_rig.hpp"
#include "target.hpp"
#include "tree.hpp"

namespace isorig::fuzz {
namespace {

/// The rig ticks while an answer is waited for, and in no other moment.
class Served {
 public:
  Served() : folder_(scratch() / "served"), config_(daemon::load_rig(test::source_path("/config/rigs/sim.toml"))) {
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directories(folder_);
    config_.core.recorder_age_max_s = 1e6;  // virtual time does not wait for a disk
    config_.recording.min_free_bytes = config_.recording.reserve_bytes = std::uint64_t{1} << 20U;
    rig_ = std::make_unique<daemon::VirtualRig>(config_);
    daemon::Host::Options options;
    options.runs_root = folder_ / "runs";
    options.revision = "0123456789ab";
    host_ = std::make_unique<daemon::Host>(config_, rig_->core(), rig_->streams, options);
    api_ = std::make_unique<daemon::Api>(*host_, folder_ / "s", 0600);
    threads_.emplace_back([this] { api_->serve(); });
    threads_.emplace_back([this] { api_->serve_stops(); });
    threads_.emplace_back([this] { api_->work(); });
    for (int i = 0; i < 20'000 && rig_->core().status().control.state != daemon::RunState::kReady; ++i) turn();
    require(rig_->core().status().control.state == daemon::RunState::kReady, "the simulated rig is not ready");
  }
  ~Served() {
    api_->stop();
    for (auto& thread : threads_) thread.join();
    host_->shut_down();
  }
  Served(const Served&) = delete;
  Served& operator=(const Served&) = delete;

  void turn() {
    rig_->tick();
    host_->turn(rig_->now_ns());
  }
  /// Runs that were started take room.
  [[nodiscard]] bool worn() const {
    std::error_code none;
    std::size_t entries = 0;
    for (auto it = std::filesystem::directory_iterator(folder_ / "runs", none); it != std::filesystem::end(it); ++it)
      ++entries;
    return entries > 40;
  }

  void exchange(const std::string& request, bool stops) {
    const int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::strcpy(address.sun_path, ((folder_ / "s").string() + (stops ? ".stop" : "")).c_str());
    require(::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0, "nobody listens");
    const auto got = talk(fd, request, [this] { turn(); });
    ::close(fd);
    check_answers(got);
  }

 private:
  std::filesystem::path folder_;
  daemon::RigConfig config_;
  std::unique_ptr<daemon::VirtualRig> rig_;
  std::unique_ptr<daemon::Host> host_;
  std::unique_ptr<daemon::Api> api_;
  std::vector<std::thread> threads_;
};

}  // namespace
}  // namespace isorig::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isorig::fuzz;
  Served& served = server_for_next_input<Served>(512, [](const Served& used) { return used.worn(); });
  Input in(data, size);
  const auto how = in.byte();
  std::string request;
  if ((how & 2U) != 0) {
    const std::string line(text(in.part())), body(text(in.rest()));
    request = line + " HTTP/1.1\r\nHost: x\r\nConnection: close\r\nContent-Length: " + std::to_string(body.size()) +
              "\r\n\r\n" + body;
  } else {
    request = text(in.rest());
  }
  served.exchange(request, (how & 1U) != 0);
  return 0;
}
