#pragma once
#include <cstdint>
#include <random>
#include <span>
#include <string_view>

namespace isorig::proof {

/// Random numbers that are the same on every machine: the engine is fixed by the C++ standard, and the
/// distributions are ours, since those of the standard library are not.
class Random {
 public:
  /// Streams of one seed are independent: what one of them draws does not move the others.
  Random(std::uint64_t seed, std::string_view stream);

  [[nodiscard]] std::uint64_t bits() { return engine_(); }
  [[nodiscard]] double uniform(double low, double high);
  [[nodiscard]] double log_uniform(double low, double high);
  [[nodiscard]] double normal();
  [[nodiscard]] std::size_t index(std::size_t count);
  [[nodiscard]] bool chance(double probability) { return uniform(0.0, 1.0) < probability; }
  [[nodiscard]] double sign() { return chance(0.5) ? 1.0 : -1.0; }

  template <class T>
  void shuffle(std::span<T> values) {
    for (std::size_t i = values.size(); i > 1; --i) std::swap(values[i - 1], values[index(i)]);
  }

 private:
  std::mt19937_64 engine_;
  double spare_ = 0.0;
  bool has_spare_ = false;
};

}  // namespace isorig::proof
