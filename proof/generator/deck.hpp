#pragma once
#include <vector>

#include "proof/generator/random.hpp"

namespace isorig::proof {

/// Hands out every item before any comes again.
template <class T>
class Deck {
 public:
  Deck(std::vector<T> items, Random& random) : items_(std::move(items)), random_(random) {}
  T next() {
    if (at_ == 0) random_.shuffle(std::span(items_));
    T item = items_[at_];
    at_ = (at_ + 1) % items_.size();
    return item;
  }

 private:
  std::vector<T> items_;
  Random& random_;
  std::size_t at_ = 0;
};

}  // namespace isorig::proof
