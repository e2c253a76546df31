#include "fake_libusb.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <utility>

namespace isorig::pressure::fake_libusb {
namespace {

std::unique_ptr<Bus> the_bus = std::make_unique<Bus>();

// A Teensy's: 0x84 and 0x03 on interface 1, which is not the first.
constexpr libusb_endpoint_descriptor endpoint(std::uint8_t address) {
  libusb_endpoint_descriptor e{};
  e.bEndpointAddress = address;
  e.bmAttributes = LIBUSB_TRANSFER_TYPE_BULK;
  e.wMaxPacketSize = 64;
  return e;
}
constexpr std::array kEndpoints{endpoint(0x03), endpoint(0x84)};

libusb_interface_descriptor setting(std::uint8_t number, std::uint8_t interface_class) {
  libusb_interface_descriptor s{};
  s.bInterfaceNumber = number;
  s.bInterfaceClass = interface_class;
  if (interface_class != LIBUSB_CLASS_DATA) return s;
  s.bNumEndpoints = kEndpoints.size();
  s.endpoint = kEndpoints.data();
  return s;
}

}  // namespace

Bus& bus() {
  return *the_bus;
}
void start_anew() {
  the_bus = std::make_unique<Bus>();
}

std::vector<libusb_transfer*> Bus::pending_on(std::uint8_t endpoint) const {
  std::vector<libusb_transfer*> found;
  std::copy_if(pending.begin(), pending.end(), std::back_inserter(found),
               [&](const libusb_transfer* t) { return t->endpoint == endpoint; });
  return found;
}

void Bus::complete(libusb_transfer* transfer, libusb_transfer_status status, std::span<const std::uint8_t> received) {
  std::erase(pending, transfer);
  std::erase(cancelled, transfer);
  transfer->status = status;
  transfer->actual_length = static_cast<int>(received.size());
  if (!received.empty()) std::memcpy(transfer->buffer, received.data(), received.size());
  transfer->callback(transfer);
}

void Bus::return_cancelled() {
  for (auto* transfer : std::exchange(cancelled, {})) complete(transfer, LIBUSB_TRANSFER_CANCELLED);
}

}  // namespace isorig::pressure::fake_libusb

using isorig::pressure::fake_libusb::bus;

struct libusb_device_handle {};

extern "C" {

int libusb_init(libusb_context** context) {
  if (bus().init_error != 0) return bus().init_error;
  *context = nullptr;
  ++bus().contexts;
  return 0;
}
void libusb_exit(libusb_context*) {
  --bus().contexts;
}
int libusb_has_capability(std::uint32_t) {
  return 0;
}
int libusb_handle_events_timeout_completed(libusb_context*, timeval* timeout, int*) {
  std::unique_lock lock(bus().mutex);
  const auto longest = std::chrono::seconds(timeout->tv_sec) + std::chrono::microseconds(timeout->tv_usec);
  bus().woken.wait_for(lock, longest, [] { return bus().is_interrupted; });
  bus().is_interrupted = false;
  return 0;
}
void libusb_interrupt_event_handler(libusb_context*) {
  const std::lock_guard lock(bus().mutex);
  bus().is_interrupted = true;
  bus().woken.notify_all();
}

int libusb_wrap_sys_device(libusb_context*, std::intptr_t, libusb_device_handle** handle) {
  if (bus().wrap_error != 0) return bus().wrap_error;
  ++bus().opened;
  *handle = new libusb_device_handle;
  return 0;
}
void libusb_close(libusb_device_handle* handle) {
  ++bus().closed;
  delete handle;
}
libusb_device* libusb_get_device(libusb_device_handle*) {
  return nullptr;
}
int libusb_set_auto_detach_kernel_driver(libusb_device_handle*, int) {
  return 0;
}
int libusb_claim_interface(libusb_device_handle*, int interface) {
  if (const auto error = bus().claim_errors.find(interface); error != bus().claim_errors.end()) return error->second;
  bus().claimed.push_back(interface);
  return 0;
}
int libusb_release_interface(libusb_device_handle*, int interface) {
  bus().released.push_back(interface);
  return 0;
}
int libusb_get_active_config_descriptor(libusb_device*, libusb_config_descriptor** config) {
  using isorig::pressure::fake_libusb::setting;
  static std::array<libusb_interface_descriptor, 2> settings;
  settings = {setting(0, LIBUSB_CLASS_COMM),
              setting(1, bus().has_data_interface ? LIBUSB_CLASS_DATA : LIBUSB_CLASS_HID)};
  static std::array<libusb_interface, 2> interfaces;
  interfaces = {{{&settings[0], 1}, {&settings[1], 1}}};
  static libusb_config_descriptor descriptor{};
  descriptor.bNumInterfaces = 2;
  descriptor.interface = interfaces.data();
  *config = &descriptor;
  return 0;
}
void libusb_free_config_descriptor(libusb_config_descriptor*) {}

libusb_transfer* libusb_alloc_transfer(int) {
  return static_cast<libusb_transfer*>(std::calloc(1, sizeof(libusb_transfer)));
}
void libusb_free_transfer(libusb_transfer* transfer) {
  std::free(transfer);
}
int libusb_submit_transfer(libusb_transfer* transfer) {
  if (bus().submit_error != 0) return bus().submit_error;
  if (transfer->endpoint == 0) bus().line_states.push_back(libusb_control_transfer_get_setup(transfer)->wValue);
  bus().pending.push_back(transfer);
  return 0;
}
int libusb_cancel_transfer(libusb_transfer* transfer) {
  bus().cancelled.push_back(transfer);
  return 0;
}
int libusb_clear_halt(libusb_device_handle*, unsigned char endpoint) {
  bus().cleared.push_back(endpoint);
  return bus().clear_error;
}

}  // extern "C"
