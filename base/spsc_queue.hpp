#pragma once
#include <atomic>
#include <bit>
#include <cstddef>
#include <memory>
#include <type_traits>

namespace isorig::base {

/// Wait-free queue for one producer thread and one consumer thread; storage is allocated once, before the
/// loop runs. When it is full, push() returns false and counts: the loss is never silent, and the producer
/// (the real-time loop) never waits.
///
/// Indices only grow; the slot is index & mask. Each side caches the other's index so that it touches the
/// shared cache line only when its own view runs out (as in Rigtorp's SPSCQueue and folly).
template <typename T>
class SpscQueue {
  static_assert(std::is_trivially_copyable_v<T>, "crosses threads by value, without destructors");

 public:
  /// Rounds `capacity` up to a power of two.
  explicit SpscQueue(std::size_t capacity)
      : mask_(std::bit_ceil(capacity < 2 ? std::size_t{2} : capacity) - 1), slots_(new T[mask_ + 1]()) {}

  SpscQueue(const SpscQueue&) = delete;
  SpscQueue& operator=(const SpscQueue&) = delete;

  /// Producer. False when full; the item is then counted as dropped.
  bool push(const T& item) noexcept {
    const std::size_t head = head_.load(std::memory_order_relaxed);
    if (head - cached_tail_ > mask_) {
      cached_tail_ = tail_.load(std::memory_order_acquire);
      if (head - cached_tail_ > mask_) {
        dropped_.fetch_add(1, std::memory_order_relaxed);
        return false;
      }
    }
    slots_[head & mask_] = item;
    head_.store(head + 1, std::memory_order_release);
    return true;
  }

  /// Consumer. False when empty.
  bool pop(T& item) noexcept {
    const std::size_t tail = tail_.load(std::memory_order_relaxed);
    if (tail == cached_head_) {
      cached_head_ = head_.load(std::memory_order_acquire);
      if (tail == cached_head_) return false;
    }
    item = slots_[tail & mask_];
    tail_.store(tail + 1, std::memory_order_release);
    return true;
  }

  [[nodiscard]] std::size_t dropped() const noexcept { return dropped_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::size_t capacity() const noexcept { return mask_ + 1; }
  /// Approximate while the other side is active, but never more than the capacity nor below zero: the tail is
  /// read first, since it can only catch up with a head that is read later.
  [[nodiscard]] std::size_t size() const noexcept {
    const std::size_t tail = tail_.load(std::memory_order_acquire);
    const std::size_t held = head_.load(std::memory_order_acquire) - tail;
    return held <= capacity() ? held : capacity();
  }

 private:
  static constexpr std::size_t kCacheLine = 64;
  const std::size_t mask_;
  const std::unique_ptr<T[]> slots_;
  alignas(kCacheLine) std::atomic<std::size_t> head_{0};
  std::size_t cached_tail_ = 0;
  std::atomic<std::size_t> dropped_{0};
  alignas(kCacheLine) std::atomic<std::size_t> tail_{0};
  std::size_t cached_head_ = 0;
};

}  // namespace isorig::base
