#pragma once
#include <stdint.h>

/// What the device says it is: a CDC-ACM serial port with the numbers of a Teensy (USB 2.0 chapter 9; USB
/// CDC 1.2; PSTN 1.2). Endpoints are those of PJRC's own serial type, so that every tool finds what it
/// expects.
namespace isorig::firmware::usb {

inline constexpr uint16_t kVendor = 0x16C0;
inline constexpr uint16_t kProduct = 0x0483;
inline constexpr uint8_t kControlSize = 64;
inline constexpr uint8_t kNotifyEndpoint = 2;  ///< interrupt IN, never used, asked for by the class
inline constexpr uint8_t kOutEndpoint = 3;
inline constexpr uint8_t kInEndpoint = 4;
inline constexpr uint8_t kEndpoints = 5;
inline constexpr uint8_t kNotifySize = 16;
inline constexpr uint8_t kBulkSize = 64;

inline constexpr uint8_t kDevice[] = {
    18,
    1,  // DEVICE
    0x00,
    0x02,  // USB 2.0
    2,
    0,
    0,             // class CDC
    kControlSize,  //
    kVendor & 0xFF,
    kVendor >> 8,
    kProduct & 0xFF,
    kProduct >> 8,
    0x00,
    0x01,  // device release 1.0
    1,
    2,
    3,  // manufacturer, product, serial number
    1,  // configurations
};

inline constexpr uint8_t kConfiguration[] = {
    9,    2,           67,
    0,    2,           1,
    0,    0xC0,        50,  // CONFIGURATION: 2 interfaces, self powered, 100 mA
    9,    4,           0,
    0,    1,           2,
    2,    1,           0,  // INTERFACE 0: CDC, ACM
    5,    0x24,        0,
    0x10, 0x01,  // header: CDC 1.10
    5,    0x24,        1,
    0x01, 1,  // call management: by itself, interface 1
    4,    0x24,        2,
    0x06,  // ACM: line coding, line state, break
    5,    0x24,        6,
    0,    1,  // union of interfaces 0 and 1
    7,    5,           0x80 | kNotifyEndpoint,
    3,    kNotifySize, 0,
    64,  // interrupt IN
    9,    4,           1,
    0,    2,           0x0A,
    0,    0,           0,  // INTERFACE 1: CDC data
    7,    5,           kOutEndpoint,
    2,    kBulkSize,   0,
    0,  // bulk OUT
    7,    5,           0x80 | kInEndpoint,
    2,    kBulkSize,   0,
    0,  // bulk IN
};
static_assert(sizeof kDevice == 18 && sizeof kConfiguration == 67);

inline constexpr char kManufacturer[] = "isorig";
inline constexpr char kProductName[] = "isorig teensy36 pressure";

}  // namespace isorig::firmware::usb
