#include "model/slse.hpp"

namespace isorig::model {

bool SlseStack::add(const SlseParameters& parameters) noexcept {
  if (size_ == kMaxElements) return false;
  elements_[size_++] = Slse(parameters);
  return true;
}

void SlseStack::settle(double strain) noexcept {
  for (std::size_t i = 0; i < size_; ++i) elements_[i].settle(strain);
}

double SlseStack::force_N() const noexcept {
  double force_N = 0.0;
  for (std::size_t i = 0; i < size_; ++i) force_N += elements_[i].force_N();
  return force_N;
}

}  // namespace isorig::model
