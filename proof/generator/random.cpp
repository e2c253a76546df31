#include "proof/generator/random.hpp"

#include <cmath>
#include <numbers>

namespace isorig::proof {
namespace {

std::uint64_t mixed(std::uint64_t seed, std::string_view stream) {
  std::uint64_t hash = 14695981039346656037ULL ^ seed;  // FNV-1a, then the finalizer of SplitMix64
  for (const char c : stream) hash = (hash ^ static_cast<unsigned char>(c)) * 1099511628211ULL;
  hash += 0x9E3779B97F4A7C15ULL;
  hash = (hash ^ (hash >> 30)) * 0xBF58476D1CE4E5B9ULL;
  hash = (hash ^ (hash >> 27)) * 0x94D049BB133111EBULL;
  return hash ^ (hash >> 31);
}

}  // namespace

Random::Random(std::uint64_t seed, std::string_view stream) : engine_(mixed(seed, stream)) {}

double Random::uniform(double low, double high) {
  return low + (high - low) * (static_cast<double>(engine_() >> 11) * 0x1.0p-53);
}

double Random::log_uniform(double low, double high) {
  return std::exp(uniform(std::log(low), std::log(high)));
}

double Random::normal() {
  if (has_spare_) {
    has_spare_ = false;
    return spare_;
  }
  const double radius = std::sqrt(-2.0 * std::log(1.0 - uniform(0.0, 1.0)));
  const double angle = 2.0 * std::numbers::pi * uniform(0.0, 1.0);
  spare_ = radius * std::sin(angle);
  has_spare_ = true;
  return radius * std::cos(angle);
}

std::size_t Random::index(std::size_t count) {
  return static_cast<std::size_t>(uniform(0.0, static_cast<double>(count)));
}

}  // namespace isorig::proof
