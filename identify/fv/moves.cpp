#include <algorithm>
#include <cmath>

#include "base/quantile.hpp"
#include "identify/fv/ramps.hpp"

namespace isorig::identify {
namespace {

/// Between two holds: samples [first, last]; the hold before ends at `first`, the one after begins at `last`.
struct Episode {
  std::size_t first = 0;
  std::size_t last = 0;
  std::size_t hold_before_first = 0;  ///< == first when there is no hold
  std::size_t hold_after_last = 0;    ///< == last when there is none
};

struct Signal {
  std::span<const double> t_s;
  std::span<const double> x_mm;
  double sigma_mm = 0.0;
  double tolerance_mm = 0.0;
  double range_mm = 0.0;
  /// Strokes below this are noise, creep or ringing.
  [[nodiscard]] double smallest_stroke_mm() const { return std::max(5.0 * tolerance_mm, 0.01 * range_mm); }
};

Signal describe(std::span<const double> t_s, std::span<const double> x_mm) {
  Signal s{t_s, x_mm};
  const SignalNoise noise = estimate_noise(t_s, x_mm);
  const auto [low, high] = std::minmax_element(x_mm.begin(), x_mm.end());
  s.range_mm = *high - *low;
  s.sigma_mm = std::max(noise.sigma, noise.quantum / std::sqrt(12.0));
  // 8 sigma: the polyline's own vertices are noisy samples too. The last term keeps a noise-free signal from
  // being cut into as many pieces as it has curvature.
  s.tolerance_mm = std::max({8.0 * s.sigma_mm, 1.5 * noise.quantum, 2e-4 * s.range_mm});
  return s;
}

double level(const Signal& s, std::size_t first, std::size_t last) {
  return base::median(
      {s.x_mm.begin() + static_cast<std::ptrdiff_t>(first), s.x_mm.begin() + static_cast<std::ptrdiff_t>(last) + 1});
}

std::vector<Episode> find_episodes(const Signal& s, const std::vector<std::size_t>& vertices, double shortest_hold_s) {
  struct Piece {
    std::size_t first, last;
    bool moves;
  };
  // A still stretch is a chord that the tolerance can explain. Neighbouring chords of one sense are one
  // piece; a still piece that is too short to be a hold (corners, ringing) belongs to the motion round it.
  std::vector<Piece> pieces;
  auto append = [&](const Piece& p) {
    if (!pieces.empty() && pieces.back().moves == p.moves)
      pieces.back().last = p.last;
    else
      pieces.push_back(p);
  };
  for (std::size_t k = 0; k + 1 < vertices.size(); ++k) {
    const std::size_t a = vertices[k], b = vertices[k + 1];
    append({a, b, std::abs(s.x_mm[b] - s.x_mm[a]) > 3.0 * s.tolerance_mm});
  }
  const std::vector<Piece> raw = std::move(pieces);
  pieces.clear();
  for (const Piece& p : raw) {
    const bool hold = !p.moves && s.t_s[p.last] - s.t_s[p.first] >= shortest_hold_s && p.last - p.first >= 2;
    append({p.first, p.last, !hold});
  }
  std::vector<Episode> episodes;
  for (std::size_t k = 0; k < pieces.size(); ++k) {
    if (!pieces[k].moves) continue;
    Episode e{pieces[k].first, pieces[k].last, pieces[k].first, pieces[k].last};
    if (k > 0) e.hold_before_first = pieces[k - 1].first;
    if (k + 1 < pieces.size()) e.hold_after_last = pieces[k + 1].last;
    episodes.push_back(e);
  }
  return episodes;
}

/// Turning points of a stretch, each at least `swing` from the last.
std::vector<std::size_t> turning_points(const Signal& s, std::size_t first, std::size_t last, double swing_mm) {
  std::vector<std::size_t> turns{first};
  std::size_t low = first, high = first;
  int heading = 0;
  for (std::size_t i = first; i <= last; ++i) {
    if (s.x_mm[i] > s.x_mm[high]) high = i;
    if (s.x_mm[i] < s.x_mm[low]) low = i;
    if (heading >= 0 && s.x_mm[high] - s.x_mm[i] > swing_mm) {
      if (high > turns.back()) turns.push_back(high);
      heading = -1;
      low = i;
      high = i;
    } else if (heading <= 0 && s.x_mm[i] - s.x_mm[low] > swing_mm) {
      if (low > turns.back()) turns.push_back(low);
      heading = 1;
      low = i;
      high = i;
    }
  }
  if (turns.back() != last) turns.push_back(last);
  return turns;
}

/// Interpolated time at which a stretch first passes `value` on its way (in the direction of `stroke`).
double crossing_s(const Signal& s, std::size_t first, std::size_t last, double value_mm, double direction) {
  for (std::size_t i = first + 1; i <= last; ++i) {
    if (direction * (s.x_mm[i] - value_mm) < 0.0) continue;
    const double step = s.x_mm[i] - s.x_mm[i - 1];
    const double share = std::abs(step) > 0.0 ? std::clamp((value_mm - s.x_mm[i - 1]) / step, 0.0, 1.0) : 1.0;
    return s.t_s[i - 1] + share * (s.t_s[i] - s.t_s[i - 1]);
  }
  return s.t_s[last];
}

/// The leg between turning points of a cycle, or a stroke without rest at one end: its middle is a line.
void fit_middle(const Signal& s, Move& m) {
  const double stroke = m.stroke_mm();
  const double d = stroke > 0 ? 1.0 : -1.0;
  std::size_t a = m.first, b = m.last;
  while (a < b && d * (s.x_mm[a] - m.from_mm) < 0.1 * std::abs(stroke)) ++a;
  while (b > a && d * (m.to_mm - s.x_mm[b]) < 0.1 * std::abs(stroke)) --b;
  const std::size_t n = b - a + 1;
  if (n < 4) {
    m.velocity_mm_s = {kNaN, kNaN};
    m.t_start_s = s.t_s[m.first];
    m.t_end_s = s.t_s[m.last];
    return;
  }
  const Line line = fit_line(s.t_s.subspan(a, n), s.x_mm.subspan(a, n));
  m.velocity_mm_s = {line.slope, line.se_slope};
  m.t_start_s = std::max(s.t_s[m.first], line.t_mean + (m.from_mm - line.mean) / line.slope);
  m.t_end_s = std::min(s.t_s[m.last], line.t_mean + (m.to_mm - line.mean) / line.slope);
}

/// The paper's piecewise-linear ramp, x(t) = from + stroke * clamp((t - t1) / (t2 - t1), 0, 1). The levels are known
/// from the holds; the corners t1 and t2 are fitted (Gauss-Newton) to the samples up to the first arrival at the
/// target, so that overshoot does not count. With N the normal matrix and s^2 the residual's variance, widened for its
/// lag-1 correlation (segments.cpp),
///
///     v = stroke / (t2 - t1),   se_v = |stroke| / (t2 - t1)^2 * sqrt(s^2 (N11 + N22 + 2 N12) / det N)
void fit_ramp(const Signal& s, const Episode& e, Move& m) {
  const double stroke = m.stroke_mm();
  const double d = stroke > 0 ? 1.0 : -1.0;
  double t1 = crossing_s(s, e.first, e.last, m.from_mm + 0.2 * stroke, d);
  double t2 = crossing_s(s, e.first, e.last, m.from_mm + 0.8 * stroke, d);
  const double guess_s = (t2 - t1) / 0.6;
  t1 -= guess_s / 3.0;
  t2 += guess_s / 3.0;
  const double arrival_s = crossing_s(s, e.first, e.last, m.to_mm, d);
  std::size_t a = e.first;
  while (a > e.hold_before_first && s.t_s[a] > t1 - guess_s) --a;
  std::size_t b = a;
  while (b < e.last && s.t_s[b] < arrival_s) ++b;
  std::size_t inside = 0;
  for (std::size_t i = a; i <= b; ++i) inside += s.t_s[i] > t1 && s.t_s[i] < t2 ? 1 : 0;
  m.t_start_s = t1;
  m.t_end_s = t2;
  if (inside < 4 || guess_s <= 0.0) {
    m.velocity_mm_s = {kNaN, kNaN};
    return;
  }
  double n11 = 0, n12 = 0, n22 = 0, ssr = 0, lagged = 0;
  std::size_t count = 0;
  for (int iteration = 0; iteration < 30; ++iteration) {
    double g1 = 0, g2 = 0, previous = 0;
    n11 = n12 = n22 = ssr = lagged = 0;
    count = 0;
    for (std::size_t i = a; i <= b; ++i) {
      const double share = (s.t_s[i] - t1) / (t2 - t1);
      const double model = m.from_mm + stroke * std::clamp(share, 0.0, 1.0);
      const double r = s.x_mm[i] - model;
      ssr += r * r;
      lagged += r * previous;
      previous = r;
      ++count;
      if (share <= 0.0 || share >= 1.0) continue;
      const double j1 = stroke * (share - 1.0) / (t2 - t1);
      const double j2 = -stroke * share / (t2 - t1);
      n11 += j1 * j1;
      n12 += j1 * j2;
      n22 += j2 * j2;
      g1 += j1 * r;
      g2 += j2 * r;
    }
    const double det = n11 * n22 - n12 * n12;
    if (!(det > 1e-12 * n11 * n22)) break;
    const double limit = 0.2 * (t2 - t1);
    const double d1 = std::clamp((n22 * g1 - n12 * g2) / det, -limit, limit);
    const double d2 = std::clamp((n11 * g2 - n12 * g1) / det, -limit, limit);
    t1 += d1;
    t2 += d2;
    if (std::abs(d1) + std::abs(d2) < 1e-12 * (t2 - t1) + 1e-12) break;
  }
  m.t_start_s = t1;
  m.t_end_s = t2;
  const double duration = t2 - t1;
  const double det = n11 * n22 - n12 * n12;
  const double n = static_cast<double>(count);
  const double variance = std::max(ssr / std::max(1.0, n - 2.0), s.sigma_mm * s.sigma_mm);
  const double rho = ssr > 0 ? std::clamp(lagged / ssr, 0.0, 0.98) : 0.0;
  const double inflation = rho > 2.0 / std::sqrt(n) ? (1.0 + rho) / (1.0 - rho) : 1.0;
  // Var(t2 - t1) from the inverse of the normal matrix.
  const double se_duration = std::sqrt(inflation * variance * (n11 + n22 + 2.0 * n12) / det);
  m.velocity_mm_s = {stroke / duration, std::abs(stroke) / (duration * duration) * se_duration};
}

void add_moves(const Signal& s, const Episode& e, std::vector<Move>& moves) {
  const bool rest = e.hold_before_first < e.first;
  const bool hold = e.hold_after_last > e.last;
  // The last third of the hold before: the ringing of the motion before it has died by then.
  const double from = rest ? level(s, e.first - (e.first - e.hold_before_first) / 3, e.first) : s.x_mm[e.first];
  const double to = hold ? level(s, e.last, e.hold_after_last) : s.x_mm[e.last];
  const auto begin = s.x_mm.begin() + static_cast<std::ptrdiff_t>(e.first);
  const auto [low, high] = std::minmax_element(begin, s.x_mm.begin() + static_cast<std::ptrdiff_t>(e.last) + 1);
  const double extent = *high - *low;
  if (extent < s.smallest_stroke_mm()) return;
  const double stroke = to - from;
  const double beyond = std::max(*high - std::max(from, to), std::min(from, to) - *low);
  // Overshoot and ringing stay below a third of the stroke; a turning point does not.
  const bool single = std::abs(stroke) > s.smallest_stroke_mm() && beyond < 0.3 * std::abs(stroke) &&
                      turning_points(s, e.first, e.last, 0.3 * extent).size() == 2;
  if (single) {
    Move m{MoveKind::kIsoVelocity, e.first, e.last, 0, 0, from, to, {}};
    if (rest && hold)
      fit_ramp(s, e, m);
    else
      fit_middle(s, m);
    moves.push_back(m);
    return;
  }
  const auto turns = turning_points(s, e.first, e.last, 0.1 * extent);
  for (std::size_t k = 0; k + 1 < turns.size(); ++k) {
    Move m{MoveKind::kCycle, turns[k], turns[k + 1], 0, 0, s.x_mm[turns[k]], s.x_mm[turns[k + 1]], {}};
    if (std::abs(m.stroke_mm()) < s.smallest_stroke_mm()) continue;
    fit_middle(s, m);
    moves.push_back(m);
  }
}

/// A speed for comparing moves: where samples are too few for a velocity, at least the stroke over its
/// duration.
double rough_speed(const Move& m) {
  return std::isfinite(m.velocity_mm_s.value) ? std::abs(m.velocity_mm_s.value)
                                              : std::abs(m.stroke_mm()) / (m.t_end_s - m.t_start_s);
}

/// What each stroke is for, from the strokes round it.
void classify(const Signal& s, std::vector<Move>& moves) {
  const Move* ramp = nullptr;
  std::vector<double> return_speeds;
  for (Move& m : moves) {
    if (m.kind != MoveKind::kIsoVelocity) continue;
    const double speed = rough_speed(m);
    if (ramp != nullptr && m.stroke_mm() * ramp->stroke_mm() < 0.0 &&
        std::abs(m.to_mm - ramp->from_mm) < 0.1 * std::abs(ramp->stroke_mm()) + s.tolerance_mm &&
        speed < 0.6 * rough_speed(*ramp)) {
      m.kind = MoveKind::kReturn;
      return_speeds.push_back(speed);
    } else {
      ramp = &m;
    }
  }
  if (return_speeds.empty()) return;
  // Where returns are, a stroke as slow as they are before the first of the ramps they undo is preparation.
  const double return_speed = base::median(return_speeds);
  for (Move& m : moves) {
    if (m.kind == MoveKind::kReturn) break;
    if (m.kind == MoveKind::kIsoVelocity && rough_speed(m) < 1.5 * return_speed) m.kind = MoveKind::kPreconditioning;
  }
}

}  // namespace

std::vector<Move> find_moves(std::span<const double> t_s, std::span<const double> position_mm,
                             const RampOptions& options) {
  std::vector<Move> moves;
  if (t_s.size() < 8) return moves;
  const Signal s = describe(t_s, position_mm);
  if (s.range_mm <= 3.0 * s.tolerance_mm) return moves;
  for (const Episode& e : find_episodes(s, polyline(t_s, position_mm, s.tolerance_mm), options.shortest_hold_s))
    add_moves(s, e, moves);
  classify(s, moves);
  return moves;
}

}  // namespace isorig::identify
