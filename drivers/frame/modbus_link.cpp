#include "drivers/frame/modbus_link.hpp"

#include <fcntl.h>
#include <modbus/modbus.h>
#include <sys/select.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "drivers/tcp_connect.hpp"

namespace isorig::frame {
namespace {

using drivers::DeviceError;
using drivers::Fault;

/// libmodbus 3.1.6 waits with select(), and a descriptor from FD_SETSIZE on writes outside its fd_set.
bool too_high(int fd) {
  return fd >= FD_SETSIZE;
}

}  // namespace

void ModbusLink::Free::operator()(_modbus* context) const noexcept {
  modbus_free(context);
}

ModbusLink::ModbusLink(const ModbusConfig& config, ReadBlock probe, std::string device)
    : config_(config), device_(std::move(device)), probe_block_(std::move(probe)) {
  if (config_.transport == ModbusTransport::kTcp) {
    // The library copies an address of at most 15 characters and never uses it: connect_tcp() opens the
    // socket.
    context_.reset(modbus_new_tcp("127.0.0.1", config_.port));
  } else {
    context_.reset(modbus_new_rtu(config_.tty.c_str(), config_.baud, config_.parity, config_.data_bits,
                                  config_.stop_bits));
    const int bits = 1 + config_.data_bits + (config_.parity == 'N' ? 0 : 1) + config_.stop_bits;
    gap_ns_ = config_.frame_gap_us > 0
                  ? std::int64_t{config_.frame_gap_us} * 1000
                  : std::max<std::int64_t>(1'750'000, std::int64_t{3'500'000'000} * bits / config_.baud);
  }
  if (!context_ || modbus_set_slave(context_.get(), config_.map.unit_id) != 0) {
    throw DeviceError(Fault::kProtocol, at() + "libmodbus refuses these settings: " + modbus_strerror(errno) +
                                            "; check tty, baud and unit_id (RTU units are 1 to 247)");
  }
  modbus_set_error_recovery(context_.get(), MODBUS_ERROR_RECOVERY_NONE);
  const auto ms = static_cast<std::uint32_t>(config_.response_timeout_ms);
  modbus_set_response_timeout(context_.get(), ms / 1000, ms % 1000 * 1000);
  // No time-out of its own per byte: the response time-out then bounds the whole answer.
  modbus_set_byte_timeout(context_.get(), 0, 0);
}

ModbusLink::~ModbusLink() {
  close();
}

std::string ModbusLink::at() const {
  return device_ + " at " + config_.where() + ": ";
}

void ModbusLink::open() {
  close();
  if (config_.transport == ModbusTransport::kTcp) {
    connect_tcp();
  } else {
    connect_rtu();
  }
  open_ = true;
  // On a serial line an answer to whoever asked before us may be under way.
  in_doubt_ = config_.transport == ModbusTransport::kRtu;
  doubt_until_ns_ = in_doubt_ ? clock_.now_ns() + gap_ns_ : 0;
}

void ModbusLink::connect_tcp() {
  const int fd = drivers::connect_tcp(config_.host, config_.port, config_.connect_timeout_ms, device_ + " at " + config_.where());
  if (too_high(fd)) {
    ::close(fd);
    fail_too_high();
  }
  ::fcntl(fd, F_SETFL, ::fcntl(fd, F_GETFL) & ~O_NONBLOCK);
  modbus_set_socket(context_.get(), fd);
}

void ModbusLink::fail_too_high() const {
  throw DeviceError(Fault::kDisconnected, at() + "this process holds over 1000 open files, which libmodbus' select() cannot "
                                                 "watch: close some");
}

void ModbusLink::connect_rtu() {
  if (modbus_connect(context_.get()) != 0) {
    const int error = errno;
    throw DeviceError(Fault::kDisconnected,
                      at() + "cannot open (" + std::strerror(error) +
                          "); check that the adapter is plugged in and that this user is in group dialout");
  }
  const int fd = modbus_get_socket(context_.get());
  if (too_high(fd)) {
    modbus_close(context_.get());
    fail_too_high();
  }
  ::tcflush(fd, TCIOFLUSH);
  unanswered_.fill(false);
}

void ModbusLink::close() noexcept {
  if (open_) modbus_close(context_.get());
  open_ = false;
  in_doubt_ = false;
}

void ModbusLink::wait_for_gap() {
  if (gap_ns_ > 0) clock_.sleep_until_ns(last_byte_ns_ + gap_ns_);
}

void ModbusLink::done() noexcept {
  last_byte_ns_ = clock_.now_ns();
}

void ModbusLink::fail(int error, const std::string& what, std::size_t read_length) {
  done();
  const bool rtu = config_.transport == ModbusTransport::kRtu;
  const auto doubt = [&] {
    if (!rtu) close();
    in_doubt_ = true;
    doubt_until_ns_ = last_byte_ns_ + std::int64_t{config_.response_timeout_ms} * 1'000'000;
    unanswered_[read_length] = true;
  };
  const std::string text = at() + what + ": ";
  switch (error) {
    case ETIMEDOUT:
      doubt();
      throw DeviceError(Fault::kTimeout,
                        text + "no answer within " + std::to_string(config_.response_timeout_ms) +
                            " ms; check the cable and unit_id " + std::to_string(config_.map.unit_id) +
                            ", or raise response_timeout_ms for a slow gateway");
    case EMBXGPATH:
    case EMBXGTAR:
      throw DeviceError(Fault::kTimeout, text + "the gateway answers but cannot reach the frame behind it (" +
                                             modbus_strerror(error) + "); is the frame on?");
    case EMBXILFUN:
    case EMBXILADD:
    case EMBXILVAL:
    case EMBXSFAIL:
    case EMBXACK:
    case EMBXSBUSY:
    case EMBXNACK:
    case EMBXMEMPAR:
      throw DeviceError(Fault::kRefused, text + "refused by the gateway (" + modbus_strerror(error) + ")" +
                                             (error == EMBXILADD || error == EMBXILFUN
                                                  ? "; compare its manual with the register map"
                                                  : "; look at the frame's state and faults"));
    case EMBBADCRC:
    case EMBBADDATA:
    case EMBBADEXC:
    case EMBUNKEXC:
    case EMBMDATA:
    case EMBBADSLAVE:
      doubt();
      throw DeviceError(Fault::kProtocol,
                        text + "an answer that is not one (" + modbus_strerror(error) + "); " +
                            (rtu ? "check baud, parity and shielding" : "check what listens on this port"));
    default:
      close();
      throw DeviceError(Fault::kDisconnected, text + "connection lost (" + std::strerror(error) + ")");
  }
}

void ModbusLink::get_in_step() {
  if (!open_ && !in_doubt_) {
    throw DeviceError(Fault::kDisconnected, at() + "not connected; call connect() first");
  }
  if (!in_doubt_) return;
  if (config_.transport == ModbusTransport::kTcp) {
    ++resyncs_;
    in_doubt_ = false;
    open();
    return;
  }
  clock_.sleep_until_ns(doubt_until_ns_);
  ::tcflush(modbus_get_socket(context_.get()), TCIFLUSH);
  if (std::find(unanswered_.begin(), unanswered_.end(), true) != unanswered_.end()) {
    ++resyncs_;
    probe();
  }
  in_doubt_ = false;
}

/// Throws what the request throws; the line then stays in doubt.
void ModbusLink::probe() {
  std::array<std::uint16_t, 125> words{};
  for (std::uint16_t length = 1; length <= probe_block_.registers; ++length) {
    if (unanswered_[length]) continue;
    wait_for_gap();
    const int rc =
        probe_block_.function == 3
            ? modbus_read_registers(context_.get(), probe_block_.address, length, words.data())
            : modbus_read_input_registers(context_.get(), probe_block_.address, length, words.data());
    if (rc != length) fail(errno, "getting back in step after an error", length);
    done();
    unanswered_.fill(false);
    return;
  }
  // Every length is in doubt: as many failures in a row as the block has registers. Silence is all that is
  // left.
  clock_.sleep_until_ns(clock_.now_ns() + 2'000'000 * std::int64_t{config_.response_timeout_ms});
  ::tcflush(modbus_get_socket(context_.get()), TCIFLUSH);
  unanswered_.fill(false);
}

void ModbusLink::read(std::uint8_t function, std::uint16_t address, std::span<std::uint16_t> words) {
  get_in_step();
  wait_for_gap();
  const int count = static_cast<int>(words.size());
  const int rc = function == 3 ? modbus_read_registers(context_.get(), address, count, words.data())
                               : modbus_read_input_registers(context_.get(), address, count, words.data());
  if (rc != count) {
    fail(rc < 0 ? errno : EMBBADDATA,
         "reading registers " + std::to_string(address) + "-" + std::to_string(address + count - 1),
         words.size());
  }
  done();
}

void ModbusLink::write(std::uint8_t function, std::uint16_t address, std::span<const std::uint16_t> words) {
  get_in_step();
  wait_for_gap();
  const int count = static_cast<int>(words.size());
  const int rc = function == 6 ? modbus_write_register(context_.get(), address, words[0])
                               : modbus_write_registers(context_.get(), address, count, words.data());
  if (rc != count) {
    fail(rc < 0 ? errno : EMBBADDATA,
         "writing registers " + std::to_string(address) + "-" + std::to_string(address + count - 1), 0);
  }
  done();
}

}  // namespace isorig::frame
