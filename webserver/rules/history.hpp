#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "daemon/core/records.hpp"

/// What a page is shown after a reload: the last minutes of samples and the last day in stretches, in memory that is
/// taken once and never grows.
namespace isorig::web {

/// Lowest, highest and mean of up to two channels that are sampled together, over one stretch of a fixed grid: stretch
/// `index` reaches from index * width to (index + 1) * width on the host's clock. No sample is skipped.
struct Stretch {
  std::int64_t index = 0;
  std::array<float, 2> low{};
  std::array<float, 2> high{};
  std::array<float, 2> mean{};
};

/// Samples of one stream: a ring of the newest `raw_samples`, and of each stretch of `coarse_width_ns` lowest, highest
/// and mean, a ring of `coarse_stretches`.
class Series {
 public:
  struct Limits {
    std::size_t raw_samples = 0;
    std::size_t coarse_stretches = 17'280;  ///< 24 h of 5 s
    std::int64_t coarse_width_ns = 5'000'000'000;
  };
  explicit Series(const Limits& limits);

  /// A stamp may lie a little before the last one, where the mapping of a device's clock was corrected: it counts as
  /// the last one's. One that lies more than a second before it is of another clock, and what was there is forgotten.
  void push(std::int64_t mono_ns, double first, double second = 0.0);

  [[nodiscard]] std::size_t size() const { return count_; }
  [[nodiscard]] std::optional<std::int64_t> oldest_ns() const;
  [[nodiscard]] std::optional<std::int64_t> newest_ns() const;
  /// Times that samples were forgotten because of another clock.
  [[nodiscard]] std::uint32_t restarts() const { return restarts_; }

  /// Stretches `from` to `to` (exclusive) of `width_ns`, from the samples; those without a sample are left out.
  [[nodiscard]] std::vector<Stretch> stretches(std::int64_t width_ns, std::int64_t from, std::int64_t to) const;
  /// Of the day, from stretch `from` on; the one that still grows is left out.
  [[nodiscard]] std::vector<Stretch> coarse(std::int64_t from) const;
  /// The first stretch that still grows.
  [[nodiscard]] std::int64_t coarse_open() const { return open_.index; }

  /// What the rings take.
  [[nodiscard]] std::size_t bytes() const;

 private:
  struct Sample {
    std::int64_t mono_ns;
    std::array<float, 2> value;
  };
  struct Growing {
    std::int64_t index = 0;
    std::size_t count = 0;
    std::array<float, 2> low{}, high{};
    std::array<double, 2> sum{};
    void add(const std::array<float, 2>& value);
    [[nodiscard]] Stretch closed() const;
  };

  [[nodiscard]] const Sample& at(std::size_t i) const { return raw_[(first_ + i) % raw_.size()]; }
  void forget();

  Limits limits_;
  std::vector<Sample> raw_;
  std::size_t first_ = 0, count_ = 0;
  std::vector<Stretch> coarse_;
  std::size_t coarse_first_ = 0, coarse_count_ = 0;
  Growing open_;
  std::uint32_t restarts_ = 0;
};

/// Which samples belong together; as the page knows them.
enum class Stream : std::uint8_t {
  kFrame,     ///< position_mm, force_N
  kPressure,  ///< pressure_psi
  kControl,   ///< target_mm, setpoint_psi
  kBand,      ///< of the twin: low95_N, high95_N
  kTwin,      ///< of the twin: predicted_N, residual in standard errors
};
inline constexpr std::size_t kStreams = 5;

/// Grid of what is sent live and after a reload.
inline constexpr std::int64_t kFineWidth_ns = 20'000'000;
inline constexpr std::int64_t kFineKept_ns = 600'000'000'000;
inline constexpr std::int64_t kCoarseWidth_ns = 5'000'000'000;

/// How late the loop woke up, over the last ten minutes: of each hundredth of a second the worst tick, counted by
/// powers of two of a microsecond. Bin 0 is below 1 us, bin k from 2^(k-1) to 2^k us, the last one all above.
class Lateness {
 public:
  static constexpr std::size_t kBins = 18;
  static constexpr std::int64_t kSlots = 600;
  using Counts = std::array<std::uint32_t, kBins>;

  void add(std::int64_t mono_ns, std::uint32_t worst_wakeup_ns);
  [[nodiscard]] Counts counts() const;

 private:
  struct Slot {
    std::int64_t second = INT64_MIN;
    Counts counts{};
  };
  std::array<Slot, kSlots> slots_{};
  std::int64_t newest_ = INT64_MIN;
};

class History {
 public:
  /// Ten minutes of 1 kHz streams and a 100 Hz one, with a tenth to spare. A faster device has fewer minutes.
  History();

  void add(const daemon::FrameRecord& record);
  void add(const daemon::PressureRecord& record);
  void add(const daemon::ControlRecord& record);
  /// What the twin says of one frame sample.
  void add_twin(std::int64_t mono_ns, double predicted_N, double half_N, double residual);

  [[nodiscard]] const Series& series(Stream stream) const { return series_[static_cast<std::size_t>(stream)]; }
  /// Samples that the devices numbered and that never came; what was lost on the way from the daemon is among them.
  [[nodiscard]] std::uint64_t gaps() const { return gaps_; }
  [[nodiscard]] const Lateness& lateness() const { return lateness_; }
  [[nodiscard]] std::size_t bytes() const;

 private:
  struct Sequence {
    std::optional<std::uint32_t> last;
    /// How many numbers were passed over. A step back, or one of more than a minute, is a device that was restarted.
    std::uint64_t skipped(std::uint32_t sequence);
  };
  std::array<Series, kStreams> series_;
  std::array<Sequence, 2> sequences_;
  std::uint64_t gaps_ = 0;
  Lateness lateness_;
};

/// A block for the page (docs/web.md): u8 stream, u8 tier (0 fine, 1 coarse, 2 an answer to a zoom), u16 columns, u32
/// count, f64 index of the first stretch, f64 width in ns, then u32 index of each relative to the first, then each
/// column as f32: low, high, mean of each channel.
[[nodiscard]] std::string block(Stream stream, std::uint8_t tier, std::int64_t width_ns,
                                const std::vector<Stretch>& stretches);

}  // namespace isorig::web
