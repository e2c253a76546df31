#pragma once
#include <stdint.h>

#include "firmware/hardware.hpp"

namespace isorig::firmware {

/// Reads the ELVH (messages/elvh.hpp) so often that its own status says when it converted.
///
/// The sensor converts by itself every 0.46 ms (typical; DS-0376 p. 4) and answers "stale" until it did. It
/// is polled every 250 us: two bytes, in the same frame two more if they are not stale (p. 13 lets a master
/// end after two). A word that is not stale was converted after the previous poll and before this one, and is
/// stamped with the middle of that window: the stamp is within half a poll period of the conversion, where
/// reading at a fixed rate leaves the whole conversion period open.
///
/// What is no conversion is reported all the same, at most once in `report_period_us`, so that the host sees
/// the raw word: a sensor that went silent (stale), an absent one, a shorted line, a fault.
class ElvhReader {
 public:
  struct Options {
    uint32_t cycles_per_us = 180;
    uint32_t poll_period_us = 250;
    uint32_t report_period_us = 1'000;
    uint32_t silence_us = 2'000;  ///< stale for this long is worth a report: four conversions
    uint32_t nominal_period_us = 460;
    uint32_t min_period_us = 300;  ///< what is believed of a measured period
    uint32_t max_period_us = 1'000;
    /// So many polls in a row that find a new conversion are too many, since a sensor that converts less
    /// often than it is polled says "stale" now and then: a floating line, or a status that is stuck. Eight
    /// holds down to a period of 286 us.
    uint32_t max_current_run = 8;
    uint32_t transfer_limit_us = 500;  ///< a word takes 21 us; after this the bus itself is broken
  };

  enum class Kind : uint8_t { kNone, kConversion, kReport };
  struct Event {
    Kind kind = Kind::kNone;
    uint64_t at_cycles = 0;  ///< of the conversion; of the poll for a report
    uint32_t raw_word = 0;
    uint32_t missed = 0;  ///< conversions since the last one that nobody read, to about one
  };

  ElvhReader(const Options& options, SensorBus& bus) noexcept;

  /// Goes on with whatever is due; `clock()` gives the extended cycle count and is read anew where it
  /// matters.
  template <class Clock>
  [[nodiscard]] Event step(Clock&& clock) noexcept {
    switch (state_) {
      case State::kIdle:
        if (const uint64_t now = clock(); now >= next_poll_) {
          bus_.select(true);
          begin_poll(clock(), now);
        }
        break;
      case State::kSelected:
        if (clock() - selected_ >= select_cycles_) {
          start_word(clock(), State::kHead);
        }
        break;
      case State::kHead:
      case State::kTail:
        if (uint16_t word = 0; bus_.take_word(word)) {
          if (!take(word)) {
            start_word(clock(), State::kTail);
            break;
          }
        } else if (clock() - word_started_ < transfer_limit_) {
          break;
        } else {
          word_ = kNothing;
        }
        bus_.select(false);
        return finish(clock());
    }
    return {};
  }

  /// As measured over undisturbed runs; the nominal one before the first.
  [[nodiscard]] uint32_t period_cycles() const noexcept { return period_; }
  /// Whether the last poll found a sensor that converts.
  [[nodiscard]] bool is_healthy() const noexcept { return is_healthy_; }

  /// Of a bus that never answers: status "fault", all ones, as a line that is pulled up.
  static constexpr uint32_t kNothing = 0xFFFFFFFFU;

 private:
  enum class State : uint8_t { kIdle, kSelected, kHead, kTail };

  void begin_poll(uint64_t selected, uint64_t now) noexcept;
  void start_word(uint64_t now, State state) noexcept {
    word_started_ = now;
    state_ = state;
    bus_.start_word();
  }
  /// True when the word is complete.
  bool take(uint16_t half) noexcept;
  Event finish(uint64_t now) noexcept;
  Event conversion() noexcept;
  Event report() noexcept;
  void measure_period(uint64_t window) noexcept;
  [[nodiscard]] bool is_report_due() const noexcept { return selected_ >= next_report_; }

  Options options_;
  SensorBus& bus_;
  uint32_t select_cycles_;
  uint32_t idle_cycles_;
  uint32_t poll_cycles_;
  uint32_t transfer_limit_;

  State state_ = State::kIdle;
  uint64_t next_poll_ = 0;
  uint64_t selected_ = 0;  // SS fell: what the sensor answers was decided here
  uint64_t word_started_ = 0;
  uint64_t previous_ = 0;
  bool has_previous_ = false;
  uint32_t word_ = 0;

  bool has_converted_ = false;
  uint64_t converted_ = 0;  // the stamp of the last conversion
  uint64_t seen_ = 0;       // the poll that found it
  uint32_t current_run_ = 0;
  uint64_t next_report_ = 0;
  bool is_healthy_ = false;

  uint32_t period_;
  uint64_t run_start_ = 0;
  uint32_t run_length_ = 0;
};

}  // namespace isorig::firmware
