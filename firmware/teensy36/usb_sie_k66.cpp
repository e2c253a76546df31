#include "firmware/teensy36/usb_sie_k66.hpp"

#include "firmware/teensy36/registers.hpp"
#include "firmware/usb_descriptors.hpp"

namespace isorig::firmware::teensy36 {

using namespace k66;

namespace {

/// Chapter USBFSOTG, "Buffer Descriptor formats". The engine reads and writes these by itself.
struct Descriptor {
  volatile uint32_t control;
  volatile uint32_t address;
};

constexpr uint32_t kOwnedByEngine = 0x80;
constexpr uint32_t kData1 = 0x40;
constexpr uint32_t kCheckToggle = 0x08;
constexpr uint32_t kPidShift = 2;
constexpr uint32_t kSizeShift = 16;

__attribute__((section(".usb_table"), aligned(512))) Descriptor table[4 * usb::kEndpoints];

Descriptor& descriptor(uint8_t endpoint, bool is_in, uint8_t bank) noexcept {
  return table[endpoint * 4 + (is_in ? 2 : 0) + (bank & 1U)];
}

// Flags are cleared by writing them back.
bool take_flag(uint8_t flag) noexcept {
  if ((k66::usb(kUsbIstat) & flag) == 0) return false;
  k66::usb(kUsbIstat) = flag;
  return true;
}

}  // namespace

void UsbSieK66::start() noexcept {
  for (Descriptor& one : table) one.control = 0;
  // 48 MHz from the internal oscillator, trimmed to the host's frames: 180 MHz has no divider that gives it.
  sim_clkdiv2() = 0;
  sim_sopt2() = kSopt2UsbFromDivider | kSopt2DividerFromIrc48M;
  sim_scgc4() |= kScgc4Usb;
  mpu_rgdaac0() |= kMpuMaster4ReadWrite;
  k66::usb(kUsbClkRecoverIrcEn) = 0x03;
  k66::usb(kUsbClkRecoverCtrl) = 0xA0;

  const auto page = static_cast<uint32_t>(reinterpret_cast<uintptr_t>(table));
  k66::usb(kUsbBdtPage1) = static_cast<uint8_t>(page >> 8U);
  k66::usb(kUsbBdtPage2) = static_cast<uint8_t>(page >> 16U);
  k66::usb(kUsbBdtPage3) = static_cast<uint8_t>(page >> 24U);
  // Polled: the flags are "qualified with" these bits, but the interrupt controller is told nothing.
  k66::usb(kUsbInten) = kIstatUsed;
  k66::usb(kUsbIstat) = 0xFF;
  k66::usb(kUsbErrstat) = 0xFF;
  k66::usb(kUsbOtgIstat) = 0xFF;
  k66::usb(kUsbCtl) = kCtlEnable;
  k66::usb(kUsbUsbctrl) = 0;
  k66::usb(kUsbControl) = kControlPullUp;
}

bool UsbSieK66::take_token(Token& token) noexcept {
  const uint8_t flags = k66::usb(kUsbIstat);
  if ((flags & kIstatStall) != 0) {  // it was sent: the endpoint is to work again
    k66::usb(kUsbEndpoint0) = kEndpointOut | kEndpointIn | kEndpointHandshake;
    k66::usb(kUsbIstat) = kIstatStall;
  }
  if ((flags & kIstatError) != 0) {
    k66::usb(kUsbErrstat) = 0xFF;
    k66::usb(kUsbIstat) = kIstatError;
  }
  // A reset makes everything before it void; take_reset() is for the next poll to see.
  if ((flags & kIstatToken) == 0 || (flags & kIstatReset) != 0) return false;
  const uint8_t status = k66::usb(kUsbStat);
  token.endpoint = status >> 4U;
  token.is_in = (status & 0x08U) != 0;
  token.bank = (status >> 2U) & 1U;
  if (token.endpoint < firmware::usb::kEndpoints) {
    const uint32_t control = descriptor(token.endpoint, token.is_in, token.bank).control;
    token.pid = static_cast<Pid>((control >> kPidShift) & 0xFU);
    token.size = static_cast<uint16_t>((control >> kSizeShift) & 0x3FFU);
  }
  k66::usb(kUsbIstat) = kIstatToken;  // the next one in its queue of four
  return true;
}

bool UsbSieK66::take_reset() noexcept {
  if ((k66::usb(kUsbIstat) & kIstatReset) == 0) return false;
  k66::usb(kUsbCtl) = kCtlResetBanks;
  for (Descriptor& one : table) one.control = 0;
  k66::usb(kUsbErrstat) = 0xFF;
  // Also the tokens of before: the queue holds four.
  for (int i = 0; i < 4; ++i) k66::usb(kUsbIstat) = kIstatToken;
  k66::usb(kUsbIstat) = 0xFF;
  k66::usb(kUsbCtl) = kCtlEnable;
  return true;
}

bool UsbSieK66::take_frame_start() noexcept {
  return take_flag(kIstatFrameStart);
}
bool UsbSieK66::take_sleep() noexcept {
  return take_flag(kIstatSleep);
}

void UsbSieK66::arm(uint8_t endpoint, bool is_in, uint8_t bank, uint8_t* buffer, uint16_t size,
                    bool is_data1) noexcept {
  Descriptor& one = descriptor(endpoint, is_in, bank);
  one.address = static_cast<uint32_t>(reinterpret_cast<uintptr_t>(buffer));
  // The bytes have to be in memory before the engine owns them.
  asm volatile("dmb" ::: "memory");
  one.control = static_cast<uint32_t>(size) << kSizeShift | kOwnedByEngine | kCheckToggle | (is_data1 ? kData1 : 0U);
}

void UsbSieK66::disarm(uint8_t endpoint, bool is_in, uint8_t bank) noexcept {
  descriptor(endpoint, is_in, bank).control = 0;
}

void UsbSieK66::set_endpoint(uint8_t endpoint, Endpoint kind) noexcept {
  uint8_t bits = 0;
  if (kind == Endpoint::kControl) bits = kEndpointOut | kEndpointIn | kEndpointHandshake;
  if (kind == Endpoint::kIn) bits = kEndpointNoControl | kEndpointIn | kEndpointHandshake;
  if (kind == Endpoint::kOut) bits = kEndpointNoControl | kEndpointOut | kEndpointHandshake;
  k66::usb(kUsbEndpoint0 + 4U * endpoint) = bits;
}

void UsbSieK66::set_address(uint8_t address) noexcept {
  k66::usb(kUsbAddr) = address;
}

void UsbSieK66::stall_control() noexcept {
  k66::usb(kUsbEndpoint0) = kEndpointStall | kEndpointOut | kEndpointIn | kEndpointHandshake;
}

// Clears TXSUSPENDTOKENBUSY, which a SETUP sets.
void UsbSieK66::resume_after_setup() noexcept {
  k66::usb(kUsbCtl) = kCtlEnable;
}

}  // namespace isorig::firmware::teensy36
