// The cursor under an allocation guard, across a whole protocol with a pause: operator new counts in this
// program.
#include <gtest/gtest.h>

#include <cstdlib>
#include <new>

#include "plant.hpp"
#include "protocol/compile.hpp"
#include "protocol/cursor.hpp"
#include "tree.hpp"

namespace {
thread_local bool guarded = false;
thread_local int allocations = 0;

void* allocate(std::size_t size) {
  if (guarded) ++allocations;
  if (void* memory = std::malloc(size)) return memory;
  throw std::bad_alloc();
}
}  // namespace

void* operator new(std::size_t size) {
  return allocate(size);
}
void* operator new[](std::size_t size) {
  return allocate(size);
}
void operator delete(void* memory) noexcept {
  std::free(memory);
}
void operator delete[](void* memory) noexcept {
  std::free(memory);
}
void operator delete(void* memory, std::size_t) noexcept {
  std::free(memory);
}
void operator delete[](void* memory, std::size_t) noexcept {
  std::free(memory);
}

namespace isorig::protocol {
namespace {

TEST(Allocation, TheGuardSeesOne) {
  guarded = true;
  delete new volatile int(3);
  guarded = false;
  EXPECT_EQ(allocations, 1);
  allocations = 0;
}

TEST(Allocation, AdvanceNeverAllocates) {
  const Plan plan = compile_file(isorig::test::source_path() + "/config/protocols/vma-short.toml");
  Cursor cursor(plan);
  test::Plant plant(1'000'000);
  plant.position_mm = 0.5;
  plant.sent.reserve(1000);
  allocations = 0;
  guarded = true;
  cursor.start(plant.now_ns);
  std::int64_t ticks = 0;
  while (cursor.action().state != CursorState::kFinished && ticks < 1'000'000) {
    if (ticks == 30'000) cursor.pause(plant.now_ns);
    if (ticks == 31'000) cursor.resume(plant.now_ns);
    plant.step(cursor.advance(plant.now_ns, plant.see()));
    (void)cursor.progress(plant.now_ns);
    ++ticks;
  }
  guarded = false;
  EXPECT_EQ(allocations, 0);
  EXPECT_EQ(cursor.action().state, CursorState::kFinished);
  static_assert(noexcept(cursor.advance(0, Observation{})));
}

}  // namespace
}  // namespace isorig::protocol
