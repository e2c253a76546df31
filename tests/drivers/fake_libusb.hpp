#pragma once
#include <libusb-1.0/libusb.h>

#include <condition_variable>
#include <cstdint>
#include <map>
#include <mutex>
#include <span>
#include <vector>

/// libusb without a bus, linked before the library: what a test decides comes back, what the driver does is written
/// down. Transfers stay pending until the test completes them; completion runs the driver's callback in the caller's
/// thread, as libusb_handle_events() does.
namespace isorig::pressure::fake_libusb {

struct Bus {
  // What the bus answers.
  int init_error = 0;
  int wrap_error = 0;
  std::map<int, int> claim_errors;  ///< by interface
  bool has_data_interface = true;
  int submit_error = 0;
  int clear_error = 0;
  // What the driver did.
  std::vector<libusb_transfer*> pending, cancelled;
  std::vector<std::uint8_t> cleared;
  std::vector<int> claimed, released;
  std::vector<std::uint16_t> line_states;
  int opened = 0, closed = 0, contexts = 0;
  // Events of a context that has a thread of its own.
  std::mutex mutex;
  std::condition_variable woken;
  bool is_interrupted = false;

  [[nodiscard]] std::vector<libusb_transfer*> pending_on(std::uint8_t endpoint) const;
  /// The bus is done with it.
  void complete(libusb_transfer* transfer, libusb_transfer_status status, std::span<const std::uint8_t> received = {});
  /// Everything that was cancelled comes back so.
  void return_cancelled();
};

/// Of this test: a new one for each.
Bus& bus();
void start_anew();

}  // namespace isorig::pressure::fake_libusb
