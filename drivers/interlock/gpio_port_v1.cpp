// libgpiod 1.6: Debian 12. Kernel interface 1, without sequence numbers: a full queue is all that shows of a loss.
#include <poll.h>

#include <array>
#include <cerrno>
#include <cstdlib>

#include "drivers/interlock/gpio_common.hpp"

namespace isorig::interlock {
namespace {

struct CloseChip {
  void operator()(gpiod_chip* chip) const noexcept { gpiod_chip_close(chip); }
};
using Chip = std::unique_ptr<gpiod_chip, CloseChip>;

int flags_of(const GpioLine& line) {
  int flags = line.active_low ? GPIOD_LINE_REQUEST_FLAG_ACTIVE_LOW : 0;
  switch (line.bias) {
    case Bias::kAsIs:
      break;
    case Bias::kDisabled:
      flags |= GPIOD_LINE_REQUEST_FLAG_BIAS_DISABLE;
      break;
    case Bias::kPullUp:
      flags |= GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_UP;
      break;
    case Bias::kPullDown:
      flags |= GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_DOWN;
      break;
  }
  return flags;
}

Chip find_chip(const GpioRequest& request) {
  Chip chip;
  std::vector<std::string> found, labels;
  for (const auto& path : gpio::chip_paths()) {
    Chip candidate(gpiod_chip_open(path.c_str()));
    if (!candidate) continue;
    labels.emplace_back(gpiod_chip_label(candidate.get()));
    if (labels.back() != request.chip) continue;
    found.push_back(path);
    chip = std::move(candidate);
  }
  gpio::require_one_chip(request, found, labels);
  return chip;
}

class PortV1 final : public GpioPort {
 public:
  explicit PortV1(const GpioRequest& request) : request_(request), chip_(find_chip(request)) {
    // Closing the chip gives back every line that was requested through it.
    for (const auto& input : request.inputs) {
      gpiod_line* line = find_line(input);
      if (gpiod_line_request_both_edges_events_flags(line, request.consumer.c_str(), flags_of(input)) != 0) {
        refuse(input, line);
      }
      inputs_.push_back(line);
      waiting_.push_back({gpiod_line_event_get_fd(line), POLLIN, 0});
    }
    if (request.output) {
      output_ = find_line(*request.output);
      if (gpiod_line_request_output_flags(output_, request.consumer.c_str(), flags_of(*request.output), 0) != 0) {
        refuse(*request.output, output_);
      }
    }
  }

  bool wait(std::int64_t timeout_ns) override {
    const timespec timeout{timeout_ns / 1'000'000'000, timeout_ns % 1'000'000'000};
    const int ready = ppoll(waiting_.data(), waiting_.size(), &timeout, nullptr);
    if (ready < 0 && errno != EINTR) gpio::fail(request_, "waiting for an edge", errno);
    return ready > 0;
  }

  GpioEdges read_edges(std::span<GpioEdge> out) override {
    GpioEdges result;
    wait(0);
    for (std::size_t input = 0; input < inputs_.size(); ++input) {
      if ((waiting_[input].revents & (POLLERR | POLLHUP | POLLNVAL)) != 0) gpio::fail(request_, "edges", ENODEV);
      if ((waiting_[input].revents & POLLIN) == 0 || out.size() - result.count < kGpioQueue) continue;
      std::array<gpiod_line_event, kGpioQueue> events;
      const int count = gpiod_line_event_read_multiple(inputs_[input], events.data(), kGpioQueue);
      if (count < 0) gpio::fail(request_, "reading edges", errno);
      if (count == static_cast<int>(kGpioQueue)) ++result.lost;
      for (int i = 0; i < count; ++i) {
        const auto& event = events[static_cast<std::size_t>(i)];
        out[result.count++] = {input, event.event_type == GPIOD_LINE_EVENT_RISING_EDGE,
                               std::int64_t{event.ts.tv_sec} * 1'000'000'000 + event.ts.tv_nsec};
      }
    }
    return result;
  }

  bool level(std::size_t input) override {
    const int value = gpiod_line_get_value(inputs_[input]);
    if (value < 0) gpio::fail(request_, "reading line " + request_.inputs[input].line, errno);
    return value == 1;
  }

  void set_output(bool active) override {
    if (gpiod_line_set_value(output_, active ? 1 : 0) != 0) {
      gpio::fail(request_, "writing line " + request_.output->line, errno);
    }
  }

 private:
  gpiod_line* find_line(const GpioLine& wanted) {
    gpiod_line* line = nullptr;
    if (const auto offset = gpio::offset_of(wanted)) {
      if (*offset < gpiod_chip_num_lines(chip_.get())) line = gpiod_chip_get_line(chip_.get(), *offset);
    } else {
      line = gpiod_chip_find_line(chip_.get(), wanted.line.c_str());
    }
    if (line == nullptr) gpio::fail_missing(request_, wanted);
    return line;
  }

  [[noreturn]] void refuse(const GpioLine& wanted, gpiod_line* line) {
    const int error_number = errno;
    if (error_number != EBUSY) gpio::fail(request_, "requesting line " + wanted.line, error_number);
    gpio::fail_busy(request_, wanted, gpiod_line_update(line) == 0 ? gpiod_line_consumer(line) : nullptr);
  }

  GpioRequest request_;
  Chip chip_;
  std::vector<gpiod_line*> inputs_;
  gpiod_line* output_ = nullptr;
  std::vector<pollfd> waiting_;
};

}  // namespace

std::unique_ptr<GpioPort> open_gpio_port(const GpioRequest& request) {
  return std::make_unique<PortV1>(request);
}

}  // namespace isorig::interlock
