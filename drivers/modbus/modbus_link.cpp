#include "drivers/modbus/modbus_link.hpp"

#include <poll.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "drivers/api/error.hpp"
#include "drivers/transport/serial_port.hpp"
#include "drivers/transport/tcp_connect.hpp"

namespace isorig::modbus {
namespace {

using drivers::DeviceError;
using drivers::Fault;

/// More answers than these are not waited for: a gateway that is so far behind is disconnected from.
constexpr std::size_t kMostLate = 64;
constexpr std::size_t kMostAtOnce = 512;

bool wait_for(int fd, short events, std::int64_t timeout_ns) {
  pollfd waiting{fd, events, 0};
  const std::int64_t wait_ns = std::max<std::int64_t>(timeout_ns, 0);
  const timespec timeout{static_cast<time_t>(wait_ns / 1'000'000'000), static_cast<long>(wait_ns % 1'000'000'000)};
  return ::ppoll(&waiting, 1, &timeout, nullptr) > 0;
}

}  // namespace

ModbusLink::ModbusLink(const ModbusConfig& config, ReadBlock probe, std::string device)
    : config_(config), device_(std::move(device)), probe_block_(std::move(probe)) {
  if (!rtu()) return;
  if (config_.map.unit_id < 1 || config_.map.unit_id > 247) {
    throw DeviceError(Fault::kProtocol, at() + "RTU units are 1 to 247; check unit_id");
  }
  const int bits = 1 + config_.data_bits + (config_.parity == 'N' ? 0 : 1) + config_.stop_bits;
  gap_ns_ = config_.frame_gap_us > 0
                ? std::int64_t{config_.frame_gap_us} * 1000
                : std::max<std::int64_t>(1'750'000, std::int64_t{3'500'000'000} * bits / config_.baud);
}

ModbusLink::~ModbusLink() {
  close();
}

std::string ModbusLink::Purpose::words() const {
  if (registers == 0) return doing;
  return std::string(doing) + " registers " + std::to_string(address) + "-" + std::to_string(address + registers - 1);
}

std::string ModbusLink::at() const {
  return device_ + " at " + config_.where() + ": ";
}

// ---- connection
// -----------------------------------------------------------------------------------------------

void ModbusLink::open() {
  close();
  open_line();
  open_ = true;
  // On a serial line an answer to whoever asked before us may be under way.
  in_doubt_ = rtu();
  doubt_until_ns_ = in_doubt_ ? clock_.now_ns() + gap_ns_ : 0;
  unanswered_.fill(false);
}

void ModbusLink::open_line() {
  const auto name = device_ + " at " + config_.where();
  if (rtu()) {
    fd_ = drivers::open_serial({config_.tty, config_.baud, config_.parity, config_.data_bits, config_.stop_bits}, name);
  } else {
    fd_ = drivers::connect_tcp(config_.host, config_.port, config_.connect_timeout_ms, name);
  }
  received_.clear();
  late_.clear();
}

void ModbusLink::close() noexcept {
  if (fd_ >= 0) {
    if (rtu()) {
      drivers::close_serial(fd_);
    } else {
      ::close(fd_);
    }
  }
  fd_ = -1;
  open_ = in_doubt_ = false;
}

void ModbusLink::doubt(std::size_t read_length) noexcept {
  last_byte_ns_ = clock_.now_ns();
  in_doubt_ = true;
  if (rtu()) {
    doubt_until_ns_ = last_byte_ns_ + timeout_ns();
    unanswered_[read_length] = true;
  } else if (fd_ >= 0) {
    ::close(fd_);
    fd_ = -1;
  }
}

void ModbusLink::flush() noexcept {
  if (rtu()) ::tcflush(fd_, TCIFLUSH);
  received_.clear();
}

void ModbusLink::wait_for_gap() {
  if (gap_ns_ > 0) clock_.sleep_until_ns(last_byte_ns_ + gap_ns_);
}

void ModbusLink::get_in_step() {
  if (!open_) {
    throw DeviceError(Fault::kDisconnected, at() + "not connected; call connect() first");
  }
  if (!in_doubt_) return;
  if (!rtu()) {
    ++resyncs_;
    open();
    return;
  }
  clock_.sleep_until_ns(doubt_until_ns_);
  flush();
  if (std::find(unanswered_.begin(), unanswered_.end(), true) != unanswered_.end()) {
    ++resyncs_;
    probe();
  }
  in_doubt_ = false;
}

/// Throws what the request throws; the line then stays in doubt.
void ModbusLink::probe() {
  for (std::uint16_t length = 1; length <= probe_block_.registers; ++length) {
    if (unanswered_[length]) continue;
    (void)ask(read_request(probe_block_.function, probe_block_.address, length),
              {.doing = "getting back in step after an error"}, length);
    unanswered_.fill(false);
    return;
  }
  // Every length is in doubt: as many failures in a row as the block has registers. Silence is all that is
  // left.
  clock_.sleep_until_ns(clock_.now_ns() + 2 * timeout_ns());
  flush();
  unanswered_.fill(false);
}

// ---- bytes
// ----------------------------------------------------------------------------------------------------

void ModbusLink::send(const Message& request, const Purpose& what) {
  const auto unit = config_.map.unit_id;
  const Message frame = rtu() ? rtu_frame(unit, request) : tcp_frame(++transaction_, unit, request);
  std::span<const std::uint8_t> left(frame);
  while (!left.empty()) {
    const auto sent =
        rtu() ? ::write(fd_, left.data(), left.size()) : ::send(fd_, left.data(), left.size(), MSG_NOSIGNAL);
    if (sent > 0) {
      left = left.subspan(static_cast<std::size_t>(sent));
    } else if (sent < 0 && errno != EAGAIN && errno != EINTR) {
      fail_disconnected(what, std::strerror(errno));
    } else if (!wait_for(fd_, POLLOUT, timeout_ns())) {
      fail_disconnected(what, "it takes no more data");
    }
  }
}

/// False when nothing came by `until_ns`.
bool ModbusLink::fill(std::int64_t until_ns, const Purpose& what) {
  if (!wait_for(fd_, POLLIN, until_ns - clock_.now_ns())) return false;
  const auto room = received_.room();
  const auto size = ::read(fd_, room.data(), std::min(room.size(), kMostAtOnce));
  if (size == 0) fail_disconnected(what, "closed by the other side");
  if (size < 0 && errno != EAGAIN && errno != EINTR) fail_disconnected(what, std::strerror(errno));
  if (size > 0) received_.grow(static_cast<std::size_t>(size));
  return true;
}

bool ModbusLink::take_tcp(Frame& frame, const Purpose& what) {
  if (received_.size() < kHeader) return false;
  const std::size_t length = word_at(received_, 4);
  const auto protocol = word_at(received_, 2);
  if (protocol != 0 || length < 3 || length > 1 + kLongestPdu) {
    fail_protocol(
        what, "protocol " + std::to_string(protocol) + " and length " + std::to_string(length) + ", which is no Modbus",
        0);
  }
  const std::size_t size = 6 + length;
  if (received_.size() < size) return false;
  frame = {word_at(received_, 0), received_[6], Message(std::span(received_).subspan(kHeader, size - kHeader))};
  received_.drop_front(size);
  return true;
}

bool ModbusLink::take_rtu(Frame& frame, const Purpose& what, std::size_t read_length) {
  const auto size = rtu_answer_size(received_);
  if (size == 0U)
    fail_protocol(what, "function " + std::to_string(received_[1]) + " that nobody asked for", read_length);
  if (!size || received_.size() < *size) return false;
  const std::span<const std::uint8_t> bytes(received_.data(), *size);
  const auto crc = static_cast<std::uint16_t>(bytes[*size - 2] | (bytes[*size - 1] << 8U));
  if (crc != crc16(bytes.first(*size - 2))) fail_protocol(what, "a wrong CRC", read_length);
  frame = {0, bytes[0], Message(bytes.subspan(1, *size - 3))};
  received_.drop_front(*size);
  return true;
}

// ---- requests
// -------------------------------------------------------------------------------------------------

void ModbusLink::check(const Message& request, const Frame& frame, const Purpose& what, std::size_t read_length) {
  if (frame.unit != config_.map.unit_id) {
    fail_protocol(what, "unit " + std::to_string(frame.unit) + " instead of " + std::to_string(config_.map.unit_id),
                  read_length);
  }
  if (const auto fault = fault_in_answer(request, frame.pdu); !fault.empty()) fail_protocol(what, fault, read_length);
  last_byte_ns_ = clock_.now_ns();
  if (const auto exception = exception_in(frame.pdu)) fail_exception(what, *exception);
}

Message ModbusLink::await(const Message& request, std::int64_t until_ns, const Purpose& what, std::size_t read_length) {
  const std::int64_t since_ns = clock_.now_ns();
  for (;;) {
    Frame frame;
    while (rtu() ? take_rtu(frame, what, read_length) : take_tcp(frame, what)) {
      if (rtu() || frame.transaction == transaction_) {
        check(request, frame, what, read_length);
        return frame.pdu;
      }
      const auto late = std::find(late_.begin(), late_.end(), frame.transaction);
      if (late == late_.end()) {
        fail_protocol(
            what, "transaction " + std::to_string(frame.transaction) + " instead of " + std::to_string(transaction_),
            0);
      }
      late_.erase(late);
      ++resyncs_;
    }
    if (!fill(until_ns, what) && clock_.now_ns() >= until_ns) fail_no_answer(what, since_ns, read_length);
  }
}

Message ModbusLink::ask(const Message& request, const Purpose& what, std::size_t read_length) {
  wait_for_gap();
  if (rtu()) flush();  // noise
  send(request, what);
  std::int64_t until_ns = clock_.now_ns() + timeout_ns();
  if (limit_ns_ > 0) until_ns = std::min(until_ns, std::max(limit_ns_, clock_.now_ns()));
  return await(request, until_ns, what, read_length);
}

void ModbusLink::read(std::uint8_t function, std::uint16_t address, std::span<std::uint16_t> words) {
  get_in_step();
  const auto answer = ask(read_request(function, address, static_cast<std::uint16_t>(words.size())),
                          {"reading", address, words.size()}, words.size());
  for (std::size_t i = 0; i < words.size(); ++i) words[i] = word_at(answer, 2 + 2 * i);
}

void ModbusLink::write(std::uint8_t function, std::uint16_t address, std::span<const std::uint16_t> words) {
  get_in_step();
  (void)ask(write_request(function, address, words), {"writing", address, words.size()}, 0);
}

void ModbusLink::write_at_once(std::uint8_t function, std::uint16_t address, std::span<const std::uint16_t> words) {
  const auto request = write_request(function, address, words);
  const Purpose what{"writing", address, words.size()};
  if (!open_ || (!rtu() && in_doubt_)) get_in_step();
  const std::int64_t now_ns = clock_.now_ns(), until_ns = now_ns + timeout_ns();
  if (!rtu()) {
    send(request, what);
    try {
      (void)await(request, now_ns + timeout_ns() / 2, what, 0);
      return;
    } catch (const DeviceError& error) {
      if (error.fault() != Fault::kTimeout || in_doubt_) throw;
    }
    send(request, what);
    (void)await(request, until_ns, what, 0);
    return;
  }
  // What is in doubt stays so: the probe comes with the next call that has time for it.
  wait_for_gap();
  flush();
  send(request, what);
  for (;;) {
    Frame frame;
    try {
      while (take_rtu(frame, what, 0)) {
        const bool ours = frame.unit == config_.map.unit_id && fault_in_answer(request, frame.pdu).empty();
        if (!ours) continue;  // an answer from before
        last_byte_ns_ = clock_.now_ns();
        if (const auto exception = exception_in(frame.pdu)) fail_exception(what, *exception);
        return;
      }
    } catch (const DeviceError& error) {
      if (error.fault() != Fault::kProtocol) throw;
      received_.clear();
    }
    if (!fill(until_ns, what) && clock_.now_ns() >= until_ns) fail_no_answer(what, now_ns, 0);
  }
}

// ---- what goes wrong
// ------------------------------------------------------------------------------------------

void ModbusLink::fail_no_answer(const Purpose& what, std::int64_t since_ns, std::size_t read_length) {
  const auto waited = std::to_string((clock_.now_ns() - since_ns) / 1'000'000);
  const bool something = !received_.empty();
  if (rtu() || something || late_.size() >= kMostLate) {
    doubt(read_length);
  } else {
    late_.push_back(transaction_);
  }
  throw DeviceError(Fault::kTimeout, at() + what.words() + ": " + (something ? "half an answer" : "no answer") +
                                         " within " + waited + " ms; check the cable and unit_id " +
                                         std::to_string(config_.map.unit_id) +
                                         ", or raise response_timeout_ms for a slow gateway");
}

void ModbusLink::fail_protocol(const Purpose& what, const std::string& why, std::size_t read_length) {
  doubt(read_length);
  throw DeviceError(Fault::kProtocol,
                    at() + what.words() + ": an answer that is not one (" + why + "); " +
                        (rtu() ? "check baud, parity and shielding" : "check what listens on this port"));
}

void ModbusLink::fail_exception(const Purpose& what, std::uint8_t code) const {
  const auto text = at() + what.words() + ": ";
  const auto said = "exception " + std::to_string(code) + ", " + exception_text(code);
  if (code == 10 || code == 11) {
    throw DeviceError(Fault::kTimeout, text + "the gateway answers but cannot reach the frame behind it (" + said +
                                           "); is the frame on?");
  }
  throw DeviceError(Fault::kRefused, text + "refused by the gateway (" + said + ")" +
                                         (code == 1 || code == 2 ? "; compare its manual with the register map"
                                                                 : "; look at the frame's state and faults"));
}

void ModbusLink::fail_disconnected(const Purpose& what, const std::string& why) {
  close();
  throw DeviceError(Fault::kDisconnected, at() + what.words() + ": connection lost (" + why + ")");
}

}  // namespace isorig::modbus
