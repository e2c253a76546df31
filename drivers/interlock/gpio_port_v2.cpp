// libgpiod 2.x: Debian 13, Fedora, Arch. Kernel interface 2: one descriptor for all lines, edges numbered.
#include <poll.h>

#include <cerrno>
#include <cstdlib>

#include "drivers/interlock/gpio_common.hpp"

namespace isorig::interlock {
namespace {

template <auto Free>
struct Freed {
  template <class T>
  void operator()(T* object) const noexcept {
    Free(object);
  }
};
using Chip = std::unique_ptr<gpiod_chip, Freed<gpiod_chip_close>>;
using ChipInfo = std::unique_ptr<gpiod_chip_info, Freed<gpiod_chip_info_free>>;
using LineInfo = std::unique_ptr<gpiod_line_info, Freed<gpiod_line_info_free>>;
using Settings = std::unique_ptr<gpiod_line_settings, Freed<gpiod_line_settings_free>>;
using LineConfig = std::unique_ptr<gpiod_line_config, Freed<gpiod_line_config_free>>;
using RequestConfig = std::unique_ptr<gpiod_request_config, Freed<gpiod_request_config_free>>;
using LineRequest = std::unique_ptr<gpiod_line_request, Freed<gpiod_line_request_release>>;
using EdgeBuffer = std::unique_ptr<gpiod_edge_event_buffer, Freed<gpiod_edge_event_buffer_free>>;

gpiod_line_bias bias_of(Bias bias) {
  switch (bias) {
    case Bias::kAsIs:
      break;
    case Bias::kDisabled:
      return GPIOD_LINE_BIAS_DISABLED;
    case Bias::kPullUp:
      return GPIOD_LINE_BIAS_PULL_UP;
    case Bias::kPullDown:
      return GPIOD_LINE_BIAS_PULL_DOWN;
  }
  return GPIOD_LINE_BIAS_AS_IS;
}

Chip find_chip(const GpioRequest& request) {
  Chip chip;
  std::vector<std::string> found, labels;
  for (const auto& path : gpio::chip_paths()) {
    Chip candidate(gpiod_chip_open(path.c_str()));
    if (!candidate) continue;
    const ChipInfo info(gpiod_chip_get_info(candidate.get()));
    if (!info) continue;
    labels.emplace_back(gpiod_chip_info_get_label(info.get()));
    if (labels.back() != request.chip) continue;
    found.push_back(path);
    chip = std::move(candidate);
  }
  gpio::require_one_chip(request, found, labels);
  return chip;
}

class PortV2 final : public GpioPort {
 public:
  explicit PortV2(const GpioRequest& request)
      : request_(request),
        chip_(find_chip(request)),
        buffer_(gpiod_edge_event_buffer_new(kGpioQueue * std::max<std::size_t>(1, request.inputs.size()))),
        seen_(request.inputs.size(), 0) {
    std::vector<GpioLine> lines = request.inputs;
    if (request.output) lines.push_back(*request.output);
    const LineConfig config(gpiod_line_config_new());
    for (std::size_t i = 0; i < lines.size(); ++i) {
      const unsigned offset = find_line(lines[i]);
      offsets_.push_back(offset);
      const Settings settings(gpiod_line_settings_new());
      gpiod_line_settings_set_active_low(settings.get(), lines[i].active_low);
      if (i < request.inputs.size()) {
        gpiod_line_settings_set_direction(settings.get(), GPIOD_LINE_DIRECTION_INPUT);
        gpiod_line_settings_set_edge_detection(settings.get(), GPIOD_LINE_EDGE_BOTH);
        gpiod_line_settings_set_event_clock(settings.get(), GPIOD_LINE_CLOCK_MONOTONIC);
      } else {
        gpiod_line_settings_set_direction(settings.get(), GPIOD_LINE_DIRECTION_OUTPUT);
        gpiod_line_settings_set_output_value(settings.get(), GPIOD_LINE_VALUE_INACTIVE);
      }
      gpiod_line_settings_set_bias(settings.get(), bias_of(lines[i].bias));
      if (gpiod_line_config_add_line_settings(config.get(), &offset, 1, settings.get()) != 0) {
        gpio::fail(request_, "configuring line " + lines[i].line, errno);
      }
    }
    const RequestConfig about(gpiod_request_config_new());
    gpiod_request_config_set_consumer(about.get(), request.consumer.c_str());
    held_.reset(gpiod_chip_request_lines(chip_.get(), about.get(), config.get()));
    if (!held_) refuse(lines);
  }

  bool wait(std::int64_t timeout_ns) override {
    const int ready = gpiod_line_request_wait_edge_events(held_.get(), timeout_ns);
    if (ready < 0 && errno != EINTR) gpio::fail(request_, "waiting for an edge", errno);
    return ready > 0;
  }

  GpioEdges read_edges(std::span<GpioEdge> out) override {
    GpioEdges result;
    if (!wait(0)) return result;
    pollfd state{gpiod_line_request_get_fd(held_.get()), POLLIN, 0};
    if (poll(&state, 1, 0) > 0 && (state.revents & (POLLERR | POLLHUP | POLLNVAL)) != 0) {
      gpio::fail(request_, "edges", ENODEV);
    }
    const int count = gpiod_line_request_read_edge_events(held_.get(), buffer_.get(), out.size());
    if (count < 0) gpio::fail(request_, "reading edges", errno);
    for (int i = 0; i < count; ++i) {
      auto* event = gpiod_edge_event_buffer_get_event(buffer_.get(), static_cast<unsigned long>(i));
      const std::size_t input = input_at(gpiod_edge_event_get_line_offset(event));
      const unsigned long number = gpiod_edge_event_get_line_seqno(event);
      result.lost += static_cast<std::uint32_t>(number - seen_[input] - 1);
      seen_[input] = number;
      out[result.count++] = {input, gpiod_edge_event_get_event_type(event) == GPIOD_EDGE_EVENT_RISING_EDGE,
                             static_cast<std::int64_t>(gpiod_edge_event_get_timestamp_ns(event))};
    }
    return result;
  }

  bool level(std::size_t input) override {
    const auto value = gpiod_line_request_get_value(held_.get(), offsets_[input]);
    if (value == GPIOD_LINE_VALUE_ERROR) gpio::fail(request_, "reading line " + request_.inputs[input].line, errno);
    return value == GPIOD_LINE_VALUE_ACTIVE;
  }

  void set_output(bool active) override {
    if (gpiod_line_request_set_value(held_.get(), offsets_.back(),
                                     active ? GPIOD_LINE_VALUE_ACTIVE : GPIOD_LINE_VALUE_INACTIVE) != 0) {
      gpio::fail(request_, "writing line " + request_.output->line, errno);
    }
  }

 private:
  unsigned find_line(const GpioLine& wanted) {
    if (const auto offset = gpio::offset_of(wanted)) {
      const ChipInfo info(gpiod_chip_get_info(chip_.get()));
      if (info && *offset < gpiod_chip_info_get_num_lines(info.get())) return *offset;
    } else if (const int found = gpiod_chip_get_line_offset_from_name(chip_.get(), wanted.line.c_str()); found >= 0) {
      return static_cast<unsigned>(found);
    }
    gpio::fail_missing(request_, wanted);
  }

  [[nodiscard]] std::size_t input_at(unsigned offset) const {
    for (std::size_t i = 0; i < request_.inputs.size(); ++i) {
      if (offsets_[i] == offset) return i;
    }
    return 0;  // the kernel reports no line that was not asked for
  }

  [[noreturn]] void refuse(const std::vector<GpioLine>& lines) {
    const int error_number = errno;
    if (error_number != EBUSY) gpio::fail(request_, "requesting the lines", error_number);
    for (std::size_t i = 0; i < lines.size(); ++i) {
      const LineInfo info(gpiod_chip_get_line_info(chip_.get(), offsets_[i]));
      if (info && gpiod_line_info_is_used(info.get())) {
        gpio::fail_busy(request_, lines[i], gpiod_line_info_get_consumer(info.get()));
      }
    }
    gpio::fail(request_, "requesting the lines", error_number);
  }

  GpioRequest request_;
  Chip chip_;
  EdgeBuffer buffer_;
  std::vector<unsigned long> seen_;  // number of the last edge, by input; the kernel counts from 1
  std::vector<unsigned> offsets_;    // inputs, then the output
  LineRequest held_;
};

}  // namespace

std::unique_ptr<GpioPort> open_gpio_port(const GpioRequest& request) {
  return std::make_unique<PortV2>(request);
}

}  // namespace isorig::interlock
