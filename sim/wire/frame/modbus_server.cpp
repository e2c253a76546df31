#include "sim/wire/frame/modbus_server.hpp"

#include <modbus/modbus.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <thread>
#include <utility>

#include "sim/wire/frame/gateway_frame.hpp"
#include "sim/wire/modbus_requests.hpp"
#include "sim/wire/wire_ends.hpp"

namespace isorig::sim {
namespace {

constexpr int kIdlePoll_ms = 5;

struct FreeContext {
  void operator()(modbus_t* context) const noexcept { modbus_free(context); }
};
using Context = std::unique_ptr<modbus_t, FreeContext>;

/// One way in: a TCP port or a serial line.
struct Endpoint {
  explicit Endpoint(bool is_rtu) : rtu(is_rtu), requests(is_rtu) {}
  Context context;  // for the answers
  bool rtu;
  ModbusRequests requests;
  Fd listener;                                  // TCP
  Fd line;                                      // the TCP client, or the master side or the tty
  std::chrono::steady_clock::time_point heard;  // last request of the TCP client
  Fd keep_open;  // slave side of the pseudo-terminal: without it the master hangs up between clients
};

}  // namespace

class ModbusServer::Impl {
 public:
  Impl(Options options, frame::Device& backend, FrameWireFaults& faults)
      : options_(std::move(options)), faults_(faults), frame_(options_.map, backend, faults) {
    int pair[2];
    if (::socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, pair) != 0)
      throw_errno("frame emulator: no descriptors");
    reply_in_ = Fd(pair[0]);
    reply_out_ = Fd(pair[1]);
    if (options_.tcp) add_tcp();
    if (options_.pty) add_pty();
    if (!options_.tty.empty()) add_tty();
    thread_ = std::thread([this] { run(); });
  }

  ~Impl() {
    stop_.raise();
    thread_.join();
    if (!options_.pty_link.empty()) ::unlink(options_.pty_link.c_str());
  }

  std::uint16_t port_ = 0;
  std::string tty_;
  std::atomic<std::uint64_t> requests_{0};
  std::atomic<std::uint64_t> connections_{0};

 private:
  // ---- ways in
  // ------------------------------------------------------------------------------------------------

  void configure(modbus_t* context) {
    if (context == nullptr || modbus_set_slave(context, options_.map.unit_id) != 0) {
      throw_errno("frame emulator: libmodbus refuses unit_id " + std::to_string(options_.map.unit_id) +
                  " or the line's settings");
    }
  }

  void add_tcp() {
    Endpoint end(false);
    end.context.reset(modbus_new_tcp("127.0.0.1", options_.tcp_port));
    configure(end.context.get());
    auto listener = listen_on(options_.tcp_address, options_.tcp_port);
    end.listener = std::move(listener.fd);
    port_ = listener.port;
    endpoints_.push_back(std::move(end));
  }

  void add_pty() {
    Endpoint end(true);
    auto pty = open_pseudo_terminal(true);
    if (!options_.pty_link.empty()) link_to(pty.path, options_.pty_link);
    end.line = std::move(pty.master);
    end.keep_open = std::move(pty.slave);
    tty_ = pty.path;
    end.context.reset(modbus_new_rtu(tty_.c_str(), options_.tty_baud, options_.tty_parity, 8, 1));
    configure(end.context.get());
    endpoints_.push_back(std::move(end));
  }

  void add_tty() {
    Endpoint end(true);
    end.context.reset(modbus_new_rtu(options_.tty.c_str(), options_.tty_baud, options_.tty_parity, 8, 1));
    configure(end.context.get());
    if (modbus_connect(end.context.get()) != 0) throw_errno("frame emulator: cannot open " + options_.tty);
    end.line = Fd(modbus_get_socket(end.context.get()));
    if (tty_.empty()) tty_ = options_.tty;
    endpoints_.push_back(std::move(end));
  }

  // ---- the thread
  // ---------------------------------------------------------------------------------------------

  void run() {
    std::vector<pollfd> wait;
    for (;;) {
      wait.assign(1, {stop_.fd(), POLLIN, 0});
      for (const auto& end : endpoints_) {
        // Negative descriptors are skipped by poll().
        wait.push_back({end.line && !is_silent(end) ? -1 : end.listener.get(), POLLIN, 0});
        wait.push_back({end.line.get(), POLLIN, 0});
      }
      ::poll(wait.data(), wait.size(), kIdlePoll_ms);
      if (wait[0].revents != 0) return;
      frame_.refresh();
      for (std::size_t i = 0; i < endpoints_.size(); ++i) {
        auto& end = endpoints_[i];
        if (faults_.disconnect.load() && !end.rtu) end.line.reset();
        // A serial line is looked at when it is silent, too: that may end a request.
        if (end.line && (wait[2 + 2 * i].revents != 0 || end.rtu)) serve(end, wait[2 + 2 * i].revents != 0);
        if (wait[1 + 2 * i].revents != 0) accept(end);
      }
    }
  }

  void accept(Endpoint& end) {
    Fd client(::accept4(end.listener.get(), nullptr, nullptr, SOCK_CLOEXEC));
    if (!client || faults_.disconnect.load()) return;
    const int on = 1;
    ::setsockopt(client.get(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    end.line = std::move(client);
    end.requests.clear();
    end.heard = std::chrono::steady_clock::now();
    ++connections_;
  }

  [[nodiscard]] bool is_silent(const Endpoint& end) const {
    return std::chrono::steady_clock::now() - end.heard > std::chrono::milliseconds(options_.client_silence_ms);
  }

  /// False when the server was told to stop meanwhile.
  bool wait_ms(int duration_ms) {
    const auto until = std::chrono::steady_clock::now() + std::chrono::milliseconds(duration_ms);
    for (;;) {
      const auto left =
          std::chrono::duration_cast<std::chrono::milliseconds>(until - std::chrono::steady_clock::now()).count();
      if (left <= 0) return true;
      pollfd wait{stop_.fd(), POLLIN, 0};
      if (::poll(&wait, 1, static_cast<int>(std::min<long>(left, kIdlePoll_ms))) != 0) return false;
      frame_.refresh();
    }
  }

  // ---- requests
  // -----------------------------------------------------------------------------------------------

  void serve(Endpoint& end, bool readable) {
    const auto now = std::chrono::steady_clock::now();
    if (readable) {
      std::array<std::uint8_t, 1024> bytes{};
      const auto size = ::read(end.line.get(), bytes.data(), bytes.size());
      if (size > 0) {
        end.requests.add(std::span(bytes).first(static_cast<std::size_t>(size)), now);
      } else if (!end.rtu && (size == 0 || (errno != EAGAIN && errno != EINTR))) {
        end.line.reset();
        return;
      }
    }
    while (end.line) {
      const auto request = end.requests.next(now);
      if (!request) break;
      answer(end, *request);
    }
    if (end.requests.is_lost()) end.line.reset();
  }

  void answer(Endpoint& end, const ModbusRequests::Request& request) {
    if (end.rtu && faults_.disconnect.load()) return;  // the cable is out
    const bool broadcast = end.rtu && request.unit == 0;
    // Over TCP 0 and 255 mean whoever has this address.
    const bool ours =
        request.unit == options_.map.unit_id || broadcast || (!end.rtu && (request.unit == 0 || request.unit == 0xFF));
    if (!ours && end.rtu) return;  // another unit's on the same line
    if (std::chrono::steady_clock::now() < frame_.silent_until()) return;
    ++requests_;
    end.heard = std::chrono::steady_clock::now();
    const auto pdu = request.pdu();
    int exception = MODBUS_EXCEPTION_GATEWAY_TARGET;
    if (ours) exception = exception_for(pdu, options_.map.max_read_registers, options_.map.max_write_registers);
    if (broadcast && pdu[0] != MODBUS_FC_WRITE_SINGLE_REGISTER && pdu[0] != MODBUS_FC_WRITE_MULTIPLE_REGISTERS) return;
    if (exception == 0) exception = write(pdu);
    if (frame_.take_cut() && !end.rtu) end.line.reset();
    if (!broadcast && exception != GatewayFrame::kNoAnswer) reply(end, request, exception);
  }

  /// What a request that is right writes; nothing, of one that reads.
  int write(std::span<const std::uint8_t> pdu) {
    const auto word = [&](std::size_t at) { return static_cast<std::uint16_t>((pdu[at] << 8U) | pdu[at + 1]); };
    if (pdu[0] == MODBUS_FC_WRITE_SINGLE_REGISTER) {
      const std::array<std::uint16_t, 1> words{word(3)};
      return frame_.act(word(1), words);
    }
    if (pdu[0] != MODBUS_FC_WRITE_MULTIPLE_REGISTERS) return 0;
    std::vector<std::uint16_t> words(word(3));
    for (std::size_t i = 0; i < words.size(); ++i) words[i] = word(6 + 2 * i);
    return frame_.act(word(1), words);
  }

  void send_exception(const Endpoint& end, const ModbusRequests::Request& request,
                      const std::array<std::uint8_t, 2>& pdu) {
    std::vector<std::uint8_t> frame;
    if (!end.rtu) frame = {request.adu[0], request.adu[1], 0, 0, 0, 3};
    frame.insert(frame.end(), {request.unit, pdu[0], pdu[1]});
    if (end.rtu) {
      const auto crc = rtu_crc(frame);
      frame.insert(frame.end(), {static_cast<std::uint8_t>(crc & 0xFFU), static_cast<std::uint8_t>(crc >> 8U)});
    }
    [[maybe_unused]] const auto written = ::write(reply_in_.get(), frame.data(), frame.size());
  }

  /// libmodbus writes its answer into a socket pair, so that it can be held back, lost or damaged.
  void reply(Endpoint& end, const ModbusRequests::Request& request, int exception) {
    auto* context = end.context.get();
    std::array<std::uint8_t, MODBUS_MAX_ADU_LENGTH> answer{};
    modbus_set_socket(context, reply_in_.get());
    if (exception == 0) {
      modbus_mapping_t mapping{};
      mapping.nb_registers = static_cast<int>(frame_.image().holding().size());
      mapping.tab_registers = frame_.image().holding().data();
      mapping.nb_input_registers = static_cast<int>(frame_.image().input().size());
      mapping.tab_input_registers = frame_.image().input().data();
      modbus_reply(context, request.adu.data(), static_cast<int>(request.adu.size()), &mapping);
    } else {
      // Its own would wrap the functions from 128 on, and wait.
      const std::array<std::uint8_t, 2> pdu{static_cast<std::uint8_t>(request.pdu()[0] | 0x80U),
                                            static_cast<std::uint8_t>(exception)};
      send_exception(end, request, pdu);
    }
    const auto bytes = ::recv(reply_out_.get(), answer.data(), answer.size(), MSG_DONTWAIT);
    if (bytes <= 0) return;

    const int wait = faults_.delay_ms.load() + faults_.late_ms.exchange(0) + frame_.take_late_ms();
    if (wait > 0 && !wait_ms(wait)) return;
    if (take_one(faults_.drop)) return;
    const auto size = static_cast<std::size_t>(bytes);
    // RTU: a bit of the data, for the CRC to find. TCP has none; what can be found there is a wrong
    // transaction.
    if (take_one(faults_.corrupt)) answer[end.rtu ? size - 3 : 1] ^= 0x40U;
    const auto sent = end.rtu ? ::write(end.line.get(), answer.data(), size)
                              : ::send(end.line.get(), answer.data(), size, MSG_NOSIGNAL | MSG_DONTWAIT);
    if (sent != bytes && !end.rtu) end.line.reset();
  }

  Options options_;
  FrameWireFaults& faults_;
  GatewayFrame frame_;
  StopEvent stop_;
  Fd reply_in_, reply_out_;
  std::vector<Endpoint> endpoints_;
  std::thread thread_;
};

ModbusServer::ModbusServer(Options options, frame::Device& backend, FrameWireFaults& faults)
    : impl_(std::make_unique<Impl>(std::move(options), backend, faults)) {}
ModbusServer::~ModbusServer() = default;
std::uint16_t ModbusServer::port() const noexcept {
  return impl_->port_;
}
std::string ModbusServer::tty() const {
  return impl_->tty_;
}
std::uint64_t ModbusServer::requests() const noexcept {
  return impl_->requests_.load();
}
std::uint64_t ModbusServer::connections() const noexcept {
  return impl_->connections_.load();
}

}  // namespace isorig::sim
