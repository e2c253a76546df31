#include "identify/diagnose/signal/mains_hum.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <complex>
#include <cstddef>
#include <numbers>

#include "base/quantile.hpp"
#include "identify/diagnose/deciding/deciding.hpp"

namespace isorig::identify {
namespace {

using Phasor = std::complex<double>;

constexpr double kWindow_s = 20.0;

Phasor phasor(double turns) {
  return std::polar(1.0, 2.0 * std::numbers::pi * turns);
}

/// A row against the straight line between its neighbours.
struct Difference {
  std::size_t row = 0;
  double before = 0.0, after = 0.0;  ///< weights of the neighbours
  double scale = 1.0;                ///< to the variance of one reading
  double value = 0.0;
  std::size_t window = 0;
};

/// Normal equations of cos and sin against the differences.
struct Sums {
  double cc = 0.0, cs = 0.0, ss = 0.0, cy = 0.0, sy = 0.0;

  void add(Phasor basis, double value) {
    cc += basis.real() * basis.real();
    cs += basis.real() * basis.imag();
    ss += basis.imag() * basis.imag();
    cy += basis.real() * value;
    sy += basis.imag() * value;
  }
  Sums& operator+=(const Sums& other) {
    cc += other.cc;
    cs += other.cs;
    ss += other.ss;
    cy += other.cy;
    sy += other.sy;
    return *this;
  }
  /// Amplitudes of cos (real) and sin (imaginary); zero where the rows cannot tell the two apart.
  [[nodiscard]] Phasor amplitude() const {
    constexpr double kTold = 1e-3;
    const double determinant = cc * ss - cs * cs, trace = cc + ss;
    if (determinant <= kTold * trace * trace) return {};
    return {(ss * cy - cs * sy) / determinant, (cc * sy - cs * cy) / determinant};
  }
  [[nodiscard]] double power() const {
    const Phasor a = amplitude();
    return a.real() * cy + a.imag() * sy;
  }
};

/// Turns of the mains up to each row.
using Turns = std::vector<double>;

struct Channel {
  std::span<const double> t_s;
  std::vector<Difference> differences;
  std::size_t windows = 0;

  /// Sums of cos and sin of `harmonic` times the mains' turns, as the differences see them, by window.
  [[nodiscard]] std::vector<Sums> sums(const Turns& turns, double harmonic) const {
    std::vector<Sums> out(windows);
    const auto at = [&](std::size_t row) { return phasor(harmonic * turns[row]); };
    for (const Difference& each : differences) {
      const Phasor basis = each.scale * (at(each.row) - each.before * at(each.row - 1) - each.after * at(each.row + 1));
      out[each.window].add(basis, each.value);
    }
    return out;
  }
  [[nodiscard]] double squares() const {
    double sum = 0.0;
    for (const Difference& each : differences) sum += each.value * each.value;
    return sum;
  }
};

Channel differences_of(std::span<const double> t_s, std::span<const double> reading, const std::vector<bool>& single) {
  constexpr double kFarthest = 5.0, kMedianToSigma = 1.4826, kLongest_s = 2.0;
  Channel out{t_s, {}, 0};
  std::vector<double> sizes;
  for (std::size_t k = 1; k + 1 < t_s.size(); ++k) {
    if (!single[k - 1] || !single[k] || !single[k + 1] || t_s[k + 1] - t_s[k - 1] > kLongest_s) continue;
    Difference d;
    d.row = k;
    d.before = (t_s[k + 1] - t_s[k]) / (t_s[k + 1] - t_s[k - 1]);
    d.after = 1.0 - d.before;
    d.scale = 1.0 / std::sqrt(1.0 + d.before * d.before + d.after * d.after);
    d.value = d.scale * (reading[k] - d.before * reading[k - 1] - d.after * reading[k + 1]);
    d.window = static_cast<std::size_t>((t_s[k] - t_s[0]) / kWindow_s);
    out.windows = d.window + 1;
    sizes.push_back(std::fabs(d.value));
    out.differences.push_back(d);
  }
  // Corners and spikes are no hum.
  if (sizes.empty()) return out;
  const double far = kFarthest * kMedianToSigma * base::quantile(std::move(sizes), 0.5);
  std::erase_if(out.differences, [far](const Difference& d) { return std::fabs(d.value) > far; });
  return out;
}

struct Peak {
  double frequency_Hz = 0.0;
  double power = 0.0;    ///< explained, in squares of the channel
  double typical = 0.0;  ///< median over the other frequencies
};

struct Peaks {
  Peak steady;     ///< one phase for all
  Peak wandering;  ///< one for each window
  std::size_t trials = 0;
};

Turns turns_of(std::span<const double> t_s, double frequency_Hz) {
  Turns out;
  for (const double at_s : t_s) out.push_back(frequency_Hz * (at_s - t_s[0]));
  return out;
}

/// Where a recording is longer than the search was fine for: the best of the frequencies between its steps.
void refine(Peak& steady, const Channel& channel, double searched_step_Hz, double step_Hz) {
  const Peak found = steady;
  for (double offset_Hz = -searched_step_Hz; offset_Hz <= searched_step_Hz; offset_Hz += step_Hz) {
    const double frequency_Hz = found.frequency_Hz + offset_Hz;
    Sums all;
    for (const Sums& window : channel.sums(turns_of(channel.t_s, frequency_Hz), 1.0)) all += window;
    if (all.power() > steady.power) steady = {frequency_Hz, all.power(), found.typical};
  }
}

/// The differences of one window as columns over its rows, with weights of zero where a row has no difference, and the
/// phasor of every row, which turns on by the same angle from one frequency to the next.
class TurningWindow {
 public:
  TurningWindow(const Channel& channel, std::span<const Difference> differences, double first_Hz, double step_Hz) {
    const std::size_t first = differences.front().row - 1;
    const auto inner = static_cast<Eigen::Index>(differences.back().row - first);
    for (Eigen::ArrayXd* each : {&here_, &before_, &after_, &value_}) *each = Eigen::ArrayXd::Zero(inner);
    for (const Difference& d : differences) {
      const auto k = static_cast<Eigen::Index>(d.row - first) - 1;
      here_[k] = d.scale;
      before_[k] = d.scale * d.before;
      after_[k] = d.scale * d.after;
      value_[k] = d.value;
    }
    for (Eigen::ArrayXd* each : {&real_, &imag_, &step_real_, &step_imag_}) each->resize(inner + 2);
    for (Eigen::Index k = 0; k < inner + 2; ++k) {
      const double since_s = channel.t_s[first + static_cast<std::size_t>(k)] - channel.t_s[0];
      const Phasor now = phasor(first_Hz * since_s), step = phasor(step_Hz * since_s);
      real_[k] = now.real();
      imag_[k] = now.imag();
      step_real_[k] = step.real();
      step_imag_[k] = step.imag();
    }
  }

  /// At the present frequency; then the next is the present one.
  [[nodiscard]] Sums next() {
    const Eigen::Index n = value_.size();
    cos_ = here_ * real_.segment(1, n) - before_ * real_.head(n) - after_ * real_.tail(n);
    sin_ = here_ * imag_.segment(1, n) - before_ * imag_.head(n) - after_ * imag_.tail(n);
    const Sums sums{cos_.square().sum(), (cos_ * sin_).sum(), sin_.square().sum(), (cos_ * value_).sum(),
                    (sin_ * value_).sum()};
    turned_ = real_ * step_real_ - imag_ * step_imag_;
    imag_ = real_ * step_imag_ + imag_ * step_real_;
    real_.swap(turned_);
    return sums;
  }

 private:
  Eigen::ArrayXd here_, before_, after_, value_, real_, imag_, step_real_, step_imag_, cos_, sin_, turned_;
};

Peaks search(const Channel& channel, double mains_Hz) {
  // No mains keep their phase for longer than ten minutes: finer steps would only cost time, hours of it in a recording
  // of a day.
  constexpr double kSteps = 4.0, kCoherent_s = 600.0;
  const double beyond_Hz = deciding().hum_beyond_Hz;
  const double duration_s = channel.t_s.back() - channel.t_s.front();
  const double step_Hz = 1.0 / (kSteps * std::clamp(duration_s, kWindow_s, kCoherent_s));
  const auto count = static_cast<std::size_t>(2.0 * beyond_Hz / step_Hz) + 1;
  const double first_Hz = mains_Hz - beyond_Hz;
  // Window by window, so that its columns stay in the processor's cache for all frequencies.
  std::vector<Sums> all(count);
  std::vector<double> wandering(count);
  const std::span<const Difference> differences(channel.differences);
  for (auto begin = differences.begin(); begin != differences.end();) {
    const auto end =
        std::find_if(begin, differences.end(), [&](const Difference& d) { return d.window != begin->window; });
    TurningWindow window(channel, {begin, end}, first_Hz, step_Hz);
    for (std::size_t f = 0; f < count; ++f) {
      const Sums sums = window.next();
      all[f] += sums;
      wandering[f] += sums.power();
    }
    begin = end;
  }
  Peaks out;
  out.trials = count;
  std::vector<double> steady;
  for (std::size_t f = 0; f < count; ++f) {
    const double frequency_Hz = first_Hz + step_Hz * static_cast<double>(f);
    steady.push_back(all[f].power());
    if (steady[f] > out.steady.power) out.steady = {frequency_Hz, steady[f], 0.0};
    if (wandering[f] > out.wandering.power) out.wandering = {frequency_Hz, wandering[f], 0.0};
  }
  out.steady.typical = base::quantile(std::move(steady), 0.5);
  out.wandering.typical = base::quantile(std::move(wandering), 0.5);
  if (duration_s > kCoherent_s) refine(out.steady, channel, step_Hz, 1.0 / (kSteps * duration_s));
  return out;
}

/// Power of noise is exponential with the median ln 2 of its mean.
bool stands_out(const Peak& peak, std::size_t trials) {
  return peak.power >
         peak.typical / std::numbers::ln2 * std::log(deciding().hum_by_chance * static_cast<double>(trials));
}

bool stands_out(const Peak& peak, const Channel& channel) {
  return channel.windows >= deciding().hum_windows &&
         peak.power >
             peak.typical * (1.0 + deciding().hum_deviations / std::sqrt(static_cast<double>(channel.windows)));
}

/// Amplitude at a time, between the middles of the windows that have one.
class Amplitudes {
 public:
  struct Known {
    double since_s;
    Phasor amplitude;
  };

  Amplitudes(const std::vector<Sums>& windows, bool steady) {
    Sums all;
    for (const Sums& window : windows) all += window;
    if (steady) {
      known_ = {{0.0, all.amplitude()}};
      return;
    }
    for (std::size_t w = 0; w < windows.size(); ++w)
      if (windows[w].cc + windows[w].ss > 0.0 && std::abs(windows[w].amplitude()) > 0.0)
        known_.push_back({(static_cast<double>(w) + 0.5) * kWindow_s, windows[w].amplitude()});
    if (known_.empty()) known_ = {{0.0, Phasor{}}};
  }
  [[nodiscard]] Phasor at(double since_s) const {
    const auto after = std::ranges::upper_bound(known_, since_s, {}, &Known::since_s);
    if (after == known_.begin()) return known_.front().amplitude;
    if (after == known_.end()) return known_.back().amplitude;
    const Known &a = *std::prev(after), &b = *after;
    const double share = (since_s - a.since_s) / (b.since_s - a.since_s);
    return a.amplitude + share * (b.amplitude - a.amplitude);
  }

  [[nodiscard]] const std::vector<Known>& known() const { return known_; }

 private:
  std::vector<Known> known_;
};

/// Takes the phases that the windows find into the turns, by straight lines between the windows' middles: a frequency
/// that differs by more than a fraction of 1/20 s from the one searched at would cancel itself within a window.
void follow_phase(Turns& turns, const Channel& channel) {
  struct Phase {
    double since_s, turns;
  };
  std::vector<Phase> phases;
  const Amplitudes amplitudes(channel.sums(turns, 1.0), false);
  for (const auto& [since_s, amplitude] : amplitudes.known()) {
    double phase = -std::arg(amplitude) / (2.0 * std::numbers::pi);
    if (!phases.empty()) phase += std::round(phases.back().turns - phase);
    phases.push_back({since_s, phase});
  }
  if (phases.size() < 2) return;
  for (std::size_t k = 0; k < turns.size(); ++k) {
    const double since_s = channel.t_s[k] - channel.t_s[0];
    const auto found = std::ranges::upper_bound(phases, since_s, {}, &Phase::since_s);
    const auto after = std::clamp(found, phases.begin() + 1, phases.end() - 1);
    const Phase &a = *std::prev(after), &b = *after;
    turns[k] += a.turns + (since_s - a.since_s) / (b.since_s - a.since_s) * (b.turns - a.turns);
  }
}

}  // namespace

std::optional<MainsHum> find_mains_hum(std::span<const double> t_s, std::span<const double> reading,
                                       const std::vector<bool>& single) {
  const Channel channel = differences_of(t_s, reading, single);
  const auto count = static_cast<double>(channel.differences.size());
  if (channel.differences.size() < deciding().hum_fewest_rows) return std::nullopt;

  std::optional<MainsHum> found;
  double least = 0.0;
  const double squares = channel.squares();
  for (const double mains_Hz : {50.0, 60.0}) {
    const Peaks peaks = search(channel, mains_Hz);
    // n ln(squares left) + k ln n against that of no hum at all.
    const auto criterion = [&](const Peak& peak, double numbers) {
      return count * std::log(std::max(1.0 - peak.power / squares, 1e-12)) + numbers * std::log(count);
    };
    const auto take = [&](const Peak& peak, bool steady, double numbers) {
      const double now = criterion(peak, numbers);
      if (now >= least) return;
      least = now;
      found = MainsHum{peak.frequency_Hz, 0.0, steady, {}};
    };
    if (stands_out(peaks.steady, peaks.trials)) take(peaks.steady, true, 3.0);
    if (stands_out(peaks.wandering, channel))
      take(peaks.wandering, false, 1.0 + 2.0 * static_cast<double>(channel.windows));
  }
  if (!found) return std::nullopt;

  Turns turns = turns_of(t_s, found->frequency_Hz);
  constexpr int kFollow = 2;
  for (int round = 0; round < kFollow && !found->steady; ++round) follow_phase(turns, channel);

  found->reading.assign(t_s.size(), 0.0);
  double power = 0.0, rows = 0.0;
  for (const double harmonic : {1.0, 2.0, 3.0}) {
    const std::vector<Sums> windows = channel.sums(turns, harmonic);
    double explained = 0.0;
    Sums all;
    for (const Sums& window : windows) {
      all += window;
      explained += window.power();
    }
    const double steps = found->steady ? 1.0 : static_cast<double>(windows.size());
    const double noise =
        squares / count * 2.0 * (steps + std::sqrt(steps) * std::log(deciding().hum_harmonic_by_chance));
    if (harmonic > 1.0 && (found->steady ? all.power() : explained) < noise) continue;
    const Amplitudes amplitudes(windows, found->steady);
    for (std::size_t k = 0; k < t_s.size(); ++k) {
      if (!single[k]) continue;
      const Phasor turn = phasor(harmonic * turns[k]), a = amplitudes.at(t_s[k] - t_s[0]);
      found->reading[k] += a.real() * turn.real() + a.imag() * turn.imag();
    }
  }
  for (std::size_t k = 0; k < t_s.size(); ++k) {
    power += found->reading[k] * found->reading[k];
    rows += single[k] ? 1.0 : 0.0;
  }
  found->amplitude = std::sqrt(2.0 * power / std::max(rows, 1.0));
  return found;
}

}  // namespace isorig::identify
