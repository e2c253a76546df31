#include "drivers/frame/instron8800_times.hpp"

#include <algorithm>

#include "drivers/frame/instron8800_words.hpp"

namespace isorig::frame {
namespace {

constexpr double seconds_of(std::int64_t ns) {
  return 1e-9 * static_cast<double>(ns);
}

/// What a line of so many characters takes; a socket takes none.
double characters_s(const Instron8800Config& c, int characters) {
  if (c.tcp) return 0.0;
  const int bits = 1 + 8 + (c.parity == 'N' ? 0 : 1) + c.stop_bits;
  return static_cast<double>(characters * bits) / c.baud;
}

}  // namespace

Instron8800Times times_of(const Instron8800Config& c, double answer_s) noexcept {
  const double gap_s = 1e-6 * c.gap_us;
  // With CR LF: "Q134,1,0" and "-0.12345678", "Q307,1" and "0,3", "Q909" and "1", "C1,0".
  const double value_s = gap_s + characters_s(c, 10 + 13) + answer_s;
  const double check_s = gap_s + characters_s(c, 8 + 5) + answer_s;
  const double word_s = gap_s + characters_s(c, 6 + 5) + answer_s;
  const double command_s = gap_s + characters_s(c, 6);
  Instron8800Times t;
  t.value_s = value_s;
  t.round_s = 2.0 * value_s + word_s + check_s;
  t.gives_samples = t.round_s <= seconds_of(kFarApart_ns);
  // Instron8800Frame::begin_stop() asks for Q1 and twice for the position, each with a check, until the two are one.
  const double position_s = value_s + check_s;
  const double apart_s = std::max(0.0, seconds_of(kStandstill_ns) - position_s);
  const double attempt_s = word_s + check_s + 2.0 * position_s + apart_s;
  // An attempt whose first position was taken before the crosshead stood goes on to its end, and fails. What was asked
  // before the stop is answered first.
  const double last_failed_s = std::max(kStandsAfter_s + 2.0 * position_s + apart_s, value_s);
  t.confirms_s = last_failed_s + attempt_s;
  t.first_sample_s = t.round_s + value_s;  // the round begins afresh, with a position
  // C1,0 goes out again, and each one makes what follows it wait.
  const double repeated = 1.0 + command_s / seconds_of(kStopAgain_ns);
  t.confirms_s *= repeated;
  t.first_sample_s *= repeated;
  t.confirms_after_request_s = seconds_of(kSlice_ns) + gap_s + command_s + t.confirms_s;
  return t;
}

}  // namespace isorig::frame
