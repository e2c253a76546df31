#pragma once
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <type_traits>

namespace isorig::base {

/// One writer that never waits, and readers that try again when they met a store: a sequence lock over words that are
/// themselves atomic, so that a torn copy is seen and is no data race. Without fences, as in Boehm, "Can seqlocks get
/// along with programming language memory models?" (MSPC 2012), section 4: a word's release store cannot move before
/// the odd number, and a reader that saw such a word by its acquire load sees that number too.
template <typename T>
class SeqLock {
  static_assert(std::is_trivially_copyable_v<T>);
  static constexpr std::size_t kWordBytes = sizeof(std::uint64_t);
  static constexpr std::size_t kWhole = sizeof(T) / kWordBytes;
  static constexpr std::size_t kRest = sizeof(T) % kWordBytes;  ///< bytes of the last word, which may be a part of one
  static constexpr std::size_t kWords = kWhole + (kRest > 0 ? 1 : 0);

 public:
  void store(const T& value) noexcept {
    const auto* bytes = reinterpret_cast<const std::byte*>(std::addressof(value));
    const auto sequence = sequence_.load(std::memory_order_relaxed);
    sequence_.store(sequence + 1, std::memory_order_relaxed);  // odd: a store is under way
#pragma GCC unroll 8
    for (std::size_t i = 0; i < kWhole; ++i) {
      std::uint64_t word = 0;
      std::memcpy(&word, bytes + i * kWordBytes, kWordBytes);
      words_[i].store(word, std::memory_order_release);
    }
    if constexpr (kRest > 0) {
      std::uint64_t word = 0;
      std::memcpy(&word, bytes + kWhole * kWordBytes, kRest);
      words_[kWhole].store(word, std::memory_order_release);
    }
    sequence_.store(sequence + 2, std::memory_order_release);
  }

  /// The newest value; all bytes zero before the first store.
  [[nodiscard]] T load() const noexcept {
    T value;
    auto* bytes = reinterpret_cast<std::byte*>(std::addressof(value));
    for (;;) {
      const auto before = sequence_.load(std::memory_order_acquire);
#pragma GCC unroll 8
      for (std::size_t i = 0; i < kWhole; ++i) {
        const std::uint64_t word = words_[i].load(std::memory_order_acquire);
        std::memcpy(bytes + i * kWordBytes, &word, kWordBytes);
      }
      if constexpr (kRest > 0) {
        const std::uint64_t word = words_[kWhole].load(std::memory_order_acquire);
        std::memcpy(bytes + kWhole * kWordBytes, &word, kRest);
      }
      if ((before & 1U) == 0 && sequence_.load(std::memory_order_relaxed) == before) return value;
    }
  }

 private:
  std::atomic<std::uint64_t> sequence_{0};
  std::array<std::atomic<std::uint64_t>, kWords> words_{};
};

}  // namespace isorig::base
