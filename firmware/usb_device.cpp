#include "firmware/usb_device.hpp"

namespace isorig::firmware {
namespace {

// USB 2.0 table 9-4, and PSTN 1.2 table 13 for the class.
enum Request : uint8_t {
  kGetStatus = 0,
  kClearFeature = 1,
  kSetAddress = 5,
  kGetDescriptor = 6,
  kGetConfiguration = 8,
  kSetConfiguration = 9,
  kGetInterface = 10,
  kSetInterface = 11,
  kSetLineCoding = 0x20,
  kGetLineCoding = 0x21,
  kSetControlLineState = 0x22,
  kSendBreak = 0x23,
};

// bmRequestType, table 9-2.
constexpr uint8_t kToHost = 0x80;
constexpr uint8_t kClassInterface = 0x21;
constexpr uint8_t kRecipientMask = 0x1F;
constexpr uint8_t kRecipientEndpoint = 2;
constexpr uint8_t kTypeMask = 0x60;

constexpr uint8_t kDescriptorDevice = 1;
constexpr uint8_t kDescriptorConfiguration = 2;
constexpr uint8_t kDescriptorString = 3;

}  // namespace

void UsbDevice::poll() noexcept {
  if (sie_.take_reset()) reset();
  UsbSie::Token token;
  // Bounded: four is what the engine itself keeps, and a pass is to be short.
  for (int i = 0; i < 4 && sie_.take_token(token); ++i) {
    if (token.endpoint == 0) {
      control(token);
    } else if (token.endpoint == usb::kOutEndpoint && !token.is_in) {
      OutBank& bank = out_[token.bank & 1U];
      bank.size = token.size;
      bank.is_full = true;
      out_engine_bank_ = static_cast<uint8_t>((token.bank ^ 1U) & 1U);
    } else if (token.endpoint == usb::kInEndpoint && token.is_in) {
      in_engine_bank_ = static_cast<uint8_t>((token.bank ^ 1U) & 1U);
      if (in_flight_ > 0) {
        --in_flight_;
        queue_.pop();
      }
      fill_in_banks();
    }
  }
  if (sie_.take_sleep()) is_asleep_ = true;
  if (sie_.take_frame_start()) {
    is_asleep_ = false;
    if (bootloader_frames_ > 0 && --bootloader_frames_ == 0) is_bootloader_due_ = true;
  }
}

size_t UsbDevice::receive(uint8_t* out, size_t size) noexcept {
  OutBank& bank = out_[out_read_bank_];
  if (!is_configured_ || !bank.is_full || bank.size > size) return 0;
  const size_t taken = bank.size;
  for (size_t i = 0; i < taken; ++i) out[i] = bank.bytes[i];
  bank.is_full = false;
  arm_out(out_read_bank_);
  out_read_bank_ ^= 1U;
  return taken;
}

bool UsbDevice::send(const uint8_t* bytes, size_t size) noexcept {
  if (!is_configured_ || !queue_.push(bytes, size)) return false;
  fill_in_banks();
  return true;
}

void UsbDevice::discard_output() noexcept {
  queue_.keep(in_flight_);
}

void UsbDevice::reset() noexcept {
  control_in_bank_ = 0;
  out_engine_bank_ = 0;
  in_engine_bank_ = 0;
  is_sending_ = false;
  new_address_ = 0;
  awaits_line_coding_ = false;
  configure(false);
  sie_.set_address(0);
  sie_.set_endpoint(0, UsbSie::Endpoint::kControl);
  // What follows a SETUP on this endpoint, data or an empty status packet, always begins with DATA1.
  for (uint8_t bank = 0; bank < 2; ++bank) sie_.arm(0, false, bank, control_out_[bank], usb::kControlSize, false);
}

void UsbDevice::control(const UsbSie::Token& token) noexcept {
  if (token.is_in) {
    control_in_bank_ = static_cast<uint8_t>((token.bank ^ 1U) & 1U);
    if (new_address_ != 0) {  // only once its status stage is over: USB 2.0, 9.4.6
      sie_.set_address(new_address_);
      new_address_ = 0;
    }
    if (is_sending_) send_control_part();
    return;
  }
  uint8_t* bytes = control_out_[token.bank & 1U];
  if (token.pid == UsbSie::Pid::kSetup) {
    setup_.type = bytes[0];
    setup_.request = bytes[1];
    setup_.value = static_cast<uint16_t>(bytes[2] | bytes[3] << 8);
    setup_.index = static_cast<uint16_t>(bytes[4] | bytes[5] << 8);
    setup_.length = static_cast<uint16_t>(bytes[6] | bytes[7] << 8);
    sie_.arm(0, false, token.bank & 1U, bytes, usb::kControlSize, true);
    handle_setup();
    sie_.resume_after_setup();
    return;
  }
  if (awaits_line_coding_ && token.size >= kLineCodingSize) {
    awaits_line_coding_ = false;
    for (size_t i = 0; i < kLineCodingSize; ++i) line_coding_[i] = bytes[i];
    if (baud() == kBootloaderBaud) bootloader_frames_ = kBootloaderFrames;
    control_size_ = 0;
    send_control_part();
  }
  sie_.arm(0, false, token.bank & 1U, bytes, usb::kControlSize, true);
}

void UsbDevice::handle_setup() noexcept {
  sie_.disarm(0, true, 0);
  sie_.disarm(0, true, 1);
  control_toggle_ = true;
  control_size_ = 0;
  control_sent_ = 0;
  is_sending_ = false;
  new_address_ = 0;
  awaits_line_coding_ = false;
  if (!answer(setup_)) {
    sie_.stall_control();
    return;
  }
  if (awaits_line_coding_) return;
  ends_with_empty_ = control_size_ < setup_.length;
  if (control_size_ > setup_.length) control_size_ = setup_.length;
  send_control_part();  // with nothing to say: the empty packet that is the status stage
}

void UsbDevice::send_control_part() noexcept {
  const size_t left = control_size_ - control_sent_;
  const size_t size = left < usb::kControlSize ? left : size_t{usb::kControlSize};
  sie_.arm(0, true, control_in_bank_, control_in_ + control_sent_, static_cast<uint16_t>(size), control_toggle_);
  control_toggle_ = !control_toggle_;
  control_sent_ += size;
  is_sending_ = control_sent_ < control_size_ || (size == usb::kControlSize && ends_with_empty_);
}

bool UsbDevice::answer(const Setup& setup) noexcept {
  if (setup.type == kClassInterface) {
    switch (setup.request) {
      case kSetLineCoding:
        awaits_line_coding_ = setup.length >= kLineCodingSize;
        return true;
      case kSetControlLineState:
        line_state_ = setup.value;
        return true;
      case kSendBreak:
        return true;
      default:
        return false;
    }
  }
  if (setup.type == (kToHost | kClassInterface) && setup.request == kGetLineCoding) {
    put(line_coding_, kLineCodingSize);
    return true;
  }
  if ((setup.type & kTypeMask) != 0) return false;
  if ((setup.type & kRecipientMask) == kRecipientEndpoint) return answer_endpoint(setup);
  const uint8_t configuration = is_configured_ ? 1 : 0;
  constexpr uint8_t kZeros[2] = {};
  switch (setup.request) {
    case kGetStatus:
      put(kZeros, 2);
      return true;
    case kSetAddress:
      new_address_ = static_cast<uint8_t>(setup.value & 0x7FU);
      return true;
    case kGetDescriptor:
      return answer_descriptor(setup);
    case kGetConfiguration:
      put(&configuration, 1);
      return true;
    case kSetConfiguration:
      if (setup.value > 1) return false;
      configure(setup.value == 1);
      return true;
    case kGetInterface:
      put(kZeros, 1);
      return true;
    case kSetInterface:
      if (setup.value != 0) return false;
      if (is_configured_) configure(true);
      return true;
    default:
      return false;
  }
}

bool UsbDevice::answer_endpoint(const Setup& setup) noexcept {
  const uint8_t endpoint = setup.index & 0x0FU;
  if (endpoint >= usb::kEndpoints) return false;
  constexpr uint8_t kZeros[2] = {};
  if (setup.request == kGetStatus) {
    put(kZeros, 2);
    return true;
  }
  if (setup.request != kClearFeature || setup.value != 0) return false;
  // Nothing ever halts here; but the toggle starts anew with every such request (USB 2.0, 9.4.5).
  if (is_configured_ && setup.index == (usb::kInEndpoint | kToHost)) restart_in();
  if (is_configured_ && setup.index == usb::kOutEndpoint) restart_out();
  return true;
}

bool UsbDevice::answer_descriptor(const Setup& setup) noexcept {
  const uint8_t index = setup.value & 0xFFU;
  switch (setup.value >> 8) {
    case kDescriptorDevice:
      put(usb::kDevice, sizeof usb::kDevice);
      return true;
    case kDescriptorConfiguration:
      put(usb::kConfiguration, sizeof usb::kConfiguration);
      return index == 0;
    case kDescriptorString: {
      constexpr uint8_t kLanguages[] = {4, kDescriptorString, 0x09, 0x04};
      if (index == 0) put(kLanguages, sizeof kLanguages);
      if (index == 1) put_text(usb::kManufacturer);
      if (index == 2) put_text(usb::kProductName);
      if (index == 3) put_text(serial_);
      return index <= 3;
    }
    default:  // among them the qualifier, which a device that is full speed only is to refuse
      return false;
  }
}

// By way of RAM: the engine's memory accesses compete with instruction fetches for the flash.
void UsbDevice::put(const uint8_t* bytes, size_t size) noexcept {
  for (size_t i = 0; i < size && control_size_ < sizeof control_in_; ++i) control_in_[control_size_++] = bytes[i];
}

void UsbDevice::put_text(const char* text) noexcept {
  control_size_ = 2;
  for (; *text != '\0' && control_size_ + 2 <= sizeof control_in_; ++text) {
    control_in_[control_size_++] = static_cast<uint8_t>(*text);
    control_in_[control_size_++] = 0;
  }
  control_in_[0] = static_cast<uint8_t>(control_size_);
  control_in_[1] = kDescriptorString;
}

void UsbDevice::configure(bool is_configured) noexcept {
  is_configured_ = is_configured;
  line_state_ = 0;
  using Endpoint = UsbSie::Endpoint;
  sie_.set_endpoint(usb::kNotifyEndpoint, is_configured ? Endpoint::kIn : Endpoint::kOff);
  sie_.set_endpoint(usb::kOutEndpoint, is_configured ? Endpoint::kOut : Endpoint::kOff);
  sie_.set_endpoint(usb::kInEndpoint, is_configured ? Endpoint::kIn : Endpoint::kOff);
  queue_.keep(0);
  restart_in();
  restart_out();
}

void UsbDevice::restart_in() noexcept {
  sie_.disarm(usb::kInEndpoint, true, 0);
  sie_.disarm(usb::kInEndpoint, true, 1);
  in_flight_ = 0;
  in_toggle_ = false;
  if (is_configured_) fill_in_banks();
}

void UsbDevice::restart_out() noexcept {
  sie_.disarm(usb::kOutEndpoint, false, 0);
  sie_.disarm(usb::kOutEndpoint, false, 1);
  out_[0].is_full = false;
  out_[1].is_full = false;
  out_read_bank_ = out_engine_bank_;
  out_toggle_ = false;
  if (!is_configured_) return;
  arm_out(out_engine_bank_);
  arm_out(out_engine_bank_ ^ 1U);
}

void UsbDevice::arm_out(uint8_t bank) noexcept {
  sie_.arm(usb::kOutEndpoint, false, bank, out_[bank].bytes, usb::kBulkSize, out_toggle_);
  out_toggle_ = !out_toggle_;
}

void UsbDevice::fill_in_banks() noexcept {
  while (in_flight_ < 2 && in_flight_ < queue_.count()) {
    PacketQueue::Packet& packet = queue_.at(in_flight_);
    const auto bank = static_cast<uint8_t>((in_engine_bank_ ^ in_flight_) & 1U);
    sie_.arm(usb::kInEndpoint, true, bank, packet.bytes, packet.size, in_toggle_);
    in_toggle_ = !in_toggle_;
    ++in_flight_;
  }
}

uint32_t UsbDevice::get_u32(const uint8_t* bytes) noexcept {
  uint32_t value = 0;
  for (unsigned i = 0; i < 4; ++i) value |= static_cast<uint32_t>(bytes[i]) << (8U * i);
  return value;
}

}  // namespace isorig::firmware
