#include "webserver/rules/losses.hpp"

#include <algorithm>

namespace isorig::web {

void Losses::connected() {
  numbered_before_ = numbered();
  others_before_ += told_.others;
  told_ = {};
  base_.reset();
}

void Losses::told(const Told& totals) {
  if (!base_) base_ = totals.before_the_socket;  // told ahead of the first record
  told_ = totals;
}

void Losses::record() {
  if (!base_) base_ = 0;
}

std::uint64_t Losses::numbered() const {
  const auto base = base_.value_or(0);
  return numbered_before_ + told_.samples + (std::max(told_.before_the_socket, base) - base);
}

std::uint64_t Losses::all(std::uint64_t gaps) const {
  return others_before_ + told_.others + std::max(gaps, numbered());
}

}  // namespace isorig::web
