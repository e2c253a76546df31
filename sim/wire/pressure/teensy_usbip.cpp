#include "sim/wire/pressure/teensy_usbip.hpp"

#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <fstream>
#include <sstream>
#include <system_error>
#include <utility>

#include "sim/wire/pressure/teensy_descriptors.hpp"

namespace isorig::sim {
namespace {

constexpr const char* kVhci = "/sys/devices/platform/vhci_hcd.0/";
constexpr unsigned kFullSpeed = 2;        // enum usb_device_speed
constexpr unsigned kFreePort = 4;         // VDEV_ST_NULL
constexpr std::size_t kUsbipHeader = 48;  // every message begins with it
constexpr std::uint32_t kSubmit = 1, kUnlink = 2, kSubmitReply = 3, kUnlinkReply = 4;
constexpr std::size_t kPacket = 64;
constexpr std::int64_t kRebootDelay_ns = 15'000'000;  // usb_dev.c: 15 start-of-frames after 134 baud
constexpr std::uint32_t kMaxTransfer = 1U << 20U;

std::uint32_t load_be(const std::uint8_t* at) {
  return std::uint32_t{at[0]} << 24U | std::uint32_t{at[1]} << 16U | std::uint32_t{at[2]} << 8U | at[3];
}

void append_be(std::vector<std::uint8_t>& to, std::uint32_t value) {
  for (const unsigned shift : {24U, 16U, 8U, 0U}) to.push_back(static_cast<std::uint8_t>(value >> shift));
}

/// The first free full-speed port of the kernel's hub.
unsigned free_port() {
  std::ifstream status(std::string(kVhci) + "status");
  std::string line;
  while (std::getline(status, line)) {
    std::istringstream words(line);
    std::string hub;
    unsigned port = 0, state = 0;
    if (words >> hub >> port >> state && hub == "hs" && state == kFreePort) return port;
  }
  throw std::system_error(ENODEV, std::generic_category(), "no port of vhci-hcd is free; `modprobe vhci-hcd`, as root");
}

}  // namespace

TeensyUsbip::TeensyUsbip(const Options& options, pressure::Device& backend, std::int64_t now_ns, Port port)
    : EmulatedTeensy(options, backend, now_ns), port_(std::move(port)) {
  plug_in();
}

void TeensyUsbip::plug_in() {
  std::array<int, 2> pair{};
  if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, pair.data()) != 0)
    throw std::system_error(errno, std::generic_category(), "socketpair");
  try {
    std::ofstream attach(std::string(kVhci) + "attach");
    attach << free_port() << ' ' << pair[1] << ' ' << 0x10001 << ' ' << kFullSpeed << std::flush;
    if (!attach) throw std::system_error(EIO, std::generic_category(), "vhci-hcd takes no device");
  } catch (...) {
    ::close(pair[0]);
    ::close(pair[1]);
    throw;
  }
  ::close(pair[1]);  // the kernel has its own reference
  fd_ = pair[0];
  is_bootloader_ = usb_faults_.bootloader.load();
  seen_.baud = seen_.line_codings = seen_.cleared_halts = 0;
}

void TeensyUsbip::pull_out() noexcept {
  if (fd_ >= 0) ::close(std::exchange(fd_, -1));
  reads_.clear();
  writes_.clear();
  never_.clear();
  from_kernel_.clear();
  to_kernel_.clear();
  is_in_halted_ = is_out_halted_ = false;
  reboot_ns_ = 0;
  seen_.dtr = false;
}

void TeensyUsbip::follow_bootloader() {
  if (reboot_ns_ != 0 && now_ns() >= reboot_ns_) usb_faults_.bootloader = true;
  if (usb_faults_.bootloader.load() == is_bootloader_) return;
  pull_out();
  clear_line();
  plug_in();
  // Without a program the fill valve closes and the vent valve vents; the program that comes starts anew.
  if (is_bootloader_) {
    set_valves(0, 1000);
  } else {
    power_up(0);
  }
}

bool TeensyUsbip::service_port() noexcept {
  try {
    follow_bootloader();
    receive();
    strike_endpoints();
    flush();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "emulated Teensy on USB: %s\n", error.what());
    pull_out();
  }
  seen_.pending_reads = static_cast<std::uint32_t>(reads_.size());
  return seen_.dtr && !is_bootloader_;
}

void TeensyUsbip::receive() noexcept {
  std::array<std::uint8_t, 4096> buffer;
  for (;;) {
    const ssize_t size = ::recv(fd_, buffer.data(), buffer.size(), MSG_DONTWAIT);
    if (size == 0) return pull_out();  // the kernel let go of the device
    if (size < 0) break;
    from_kernel_.insert(from_kernel_.end(), buffer.begin(), buffer.begin() + size);
  }
  std::size_t used = 0;
  while (from_kernel_.size() - used >= kUsbipHeader) {
    const std::uint8_t* at = from_kernel_.data() + used;
    Request request;
    request.sequence = load_be(at + 4);
    request.is_in = load_be(at + 12) != 0;
    request.endpoint = load_be(at + 16);
    std::size_t size = kUsbipHeader;
    if (load_be(at) == kSubmit) {
      request.length = std::min(load_be(at + 24), kMaxTransfer);
      if (!request.is_in) size += request.length;
      if (from_kernel_.size() - used < size) break;
      if (!request.is_in) request.data.assign(at + kUsbipHeader, at + size);
    }
    std::array<std::uint8_t, kUsbipHeader> header{};
    std::copy_n(at, kUsbipHeader, header.begin());
    used += size;
    handle(header.data(), std::move(request));
  }
  from_kernel_.erase(from_kernel_.begin(), from_kernel_.begin() + static_cast<std::ptrdiff_t>(used));
}

void TeensyUsbip::handle(const std::uint8_t* header, Request request) {
  if (load_be(header) == kUnlink) return unlink(request.sequence, load_be(header + 20));
  switch (request.endpoint) {
    case 0:
      return control(header + 40, request);
    case 3:
      writes_.push_back(std::move(request));
      return;
    case 4:
      reads_.push_back(std::move(request));
      return;
    default:
      never_.push_back(std::move(request));
      return;
  }
}

void TeensyUsbip::unlink(std::uint32_t sequence, std::uint32_t victim) {
  bool was_pending = false;
  for (auto* queue : {&reads_, &writes_, &never_}) {
    was_pending |= std::erase_if(*queue, [&](const Request& r) { return r.sequence == victim; }) > 0;
  }
  append_be(to_kernel_, kUnlinkReply);
  append_be(to_kernel_, sequence);
  for (int i = 0; i < 3; ++i) append_be(to_kernel_, 0);
  append_be(to_kernel_, was_pending ? static_cast<std::uint32_t>(-ECONNRESET) : 0);
  to_kernel_.resize(to_kernel_.size() + kUsbipHeader - 24);
}

void TeensyUsbip::control(const std::uint8_t* setup, Request& request) {
  const std::uint8_t type = setup[0];
  const auto value = static_cast<std::uint16_t>(setup[2] | setup[3] << 8);
  bool is_known = true;
  if ((type & 0x60U) == 0x20) {
    if (usb_faults_.silent_control.load()) return never_.push_back(std::move(request));
    is_known = class_request(setup, request);
  } else if ((type & 0x60U) != 0) {
    is_known = false;
  } else {
    switch (setup[1]) {
      case 0:
        request.data = {0, 0};
        break;  // GET_STATUS
      case 1:   // CLEAR_FEATURE: the halt of an endpoint
        if (setup[4] == 0x84) is_in_halted_ = false;
        if (setup[4] == 0x03) is_out_halted_ = false;
        ++seen_.cleared_halts;
        break;
      case 6:
        is_known = get_descriptor({port_, options().core.serial, is_bootloader_}, value, request.data);
        break;
      case 8:
        request.data = {1};
        break;  // GET_CONFIGURATION
      case 5:
      case 9:
      case 11:
        break;  // SET_ADDRESS, _CONFIGURATION, _INTERFACE
      default:
        is_known = false;
    }
  }
  if (request.is_in && request.data.size() > request.length) request.data.resize(request.length);
  reply(request, is_known ? 0 : -EPIPE);
}

bool TeensyUsbip::class_request(const std::uint8_t* setup, Request& request) {
  switch (setup[1]) {
    case 0x20:  // SET_LINE_CODING
      if (request.data.size() < 7) return false;
      line_coding_ = request.data;
      seen_.baud = std::uint32_t{line_coding_[0]} | std::uint32_t{line_coding_[1]} << 8U |
                   std::uint32_t{line_coding_[2]} << 16U | std::uint32_t{line_coding_[3]} << 24U;
      ++seen_.line_codings;
      if (seen_.baud == 134) reboot_ns_ = now_ns() + kRebootDelay_ns;
      return true;
    case 0x21:
      request.data = line_coding_;
      return true;
    case 0x22:
      seen_.dtr = (setup[2] & 1U) != 0;
      return true;  // SET_CONTROL_LINE_STATE
    case 0x23:
      return true;  // SEND_BREAK
    default:
      return false;
  }
}

void TeensyUsbip::strike_endpoints() noexcept {
  if (usb_faults_.stall_in.exchange(false)) is_in_halted_ = true;
  if (usb_faults_.stall_out.exchange(false)) is_out_halted_ = true;
  const auto strike = [this](std::deque<Request>& requests, bool is_halted, std::atomic<std::uint32_t>& errors) {
    while (!requests.empty() && (is_halted || errors.load() > 0)) {
      Request failed = std::move(requests.front());
      requests.pop_front();
      failed.data.clear();
      if (!is_halted) --errors;
      reply(failed, is_halted ? -EPIPE : -EPROTO);
    }
  };
  strike(reads_, is_in_halted_, usb_faults_.errors_in);
  strike(writes_, is_out_halted_, usb_faults_.errors_out);
}

void TeensyUsbip::reply(const Request& request, std::int32_t status) {
  append_be(to_kernel_, kSubmitReply);
  append_be(to_kernel_, request.sequence);
  for (int i = 0; i < 3; ++i) append_be(to_kernel_, 0);
  append_be(to_kernel_, static_cast<std::uint32_t>(status));
  append_be(to_kernel_, static_cast<std::uint32_t>(request.is_in ? request.data.size() : request.length));
  to_kernel_.resize(to_kernel_.size() + kUsbipHeader - 28);
  if (request.is_in) to_kernel_.insert(to_kernel_.end(), request.data.begin(), request.data.end());
}

std::size_t TeensyUsbip::take(std::span<std::uint8_t> out) noexcept {
  if (writes_.empty()) return 0;
  Request& request = writes_.front();
  const std::size_t size = std::min(out.size(), request.data.size());
  std::copy_n(request.data.begin(), size, out.begin());
  request.data.erase(request.data.begin(), request.data.begin() + static_cast<std::ptrdiff_t>(size));
  if (request.data.empty()) {
    reply(request, 0);
    flush();
    writes_.pop_front();
  }
  return size;
}

std::size_t TeensyUsbip::give(std::span<const std::uint8_t> bytes) noexcept {
  std::size_t given = 0;
  while (given < bytes.size() && !reads_.empty() && !usb_faults_.silent_in.load()) {
    Request& request = reads_.front();
    const std::size_t packet = std::min({kPacket, bytes.size() - given, request.length - request.data.size()});
    request.data.insert(request.data.end(), bytes.begin() + static_cast<std::ptrdiff_t>(given),
                        bytes.begin() + static_cast<std::ptrdiff_t>(given + packet));
    given += packet;
    if (packet < kPacket || request.data.size() == request.length) {  // a short packet ends a transfer
      reply(request, 0);
      reads_.pop_front();
    }
  }
  flush();
  return given;
}

void TeensyUsbip::flush() noexcept {
  while (fd_ >= 0 && !to_kernel_.empty()) {
    const ssize_t size = ::send(fd_, to_kernel_.data(), to_kernel_.size(), MSG_DONTWAIT | MSG_NOSIGNAL);
    if (size <= 0) return;
    to_kernel_.erase(to_kernel_.begin(), to_kernel_.begin() + size);
  }
}

}  // namespace isorig::sim
