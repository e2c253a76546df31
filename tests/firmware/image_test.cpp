// The Teensy's image as it would be flashed. A wrong byte at 0x40C locks the chip for good, so that is read
// from the very file that the loader takes.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>

#include "image_file.hpp"

namespace isorig::firmware {
namespace {

constexpr std::uint32_t kFlashSize = 1U << 20U;
constexpr std::uint32_t kRamStart = 0x2000'0000;
constexpr std::uint32_t kRamEnd = 0x2003'0000;

const std::string kFolder = ISORIG_FIRMWARE_DIR;

class TeensyImage : public testing::Test {
 protected:
  const Memory hex = read_hex(kFolder + "/isorig-teensy36.hex");
  const ElfImage elf{kFolder + "/isorig-teensy36.elf"};
};

TEST_F(TeensyImage, IsForACortexM4WithHardwareFloat) {
  EXPECT_EQ(elf.header.e_machine, EM_ARM);
  EXPECT_NE(elf.header.e_flags & EF_ARM_ABI_FLOAT_HARD, 0U);
}

TEST_F(TeensyImage, FitsIntoFlashAndUpperRam) {
  EXPECT_LT(hex.rbegin()->first, kFlashSize);
  EXPECT_EQ(hex.begin()->first, 0U);
  RecordProperty("flash_bytes", static_cast<int>(hex.size()));
  EXPECT_LT(hex.size(), 32U * 1024) << "it was 14 KiB; what did it take in?";
  for (const ElfImage::Segment& segment : elf.segments) {
    if (segment.file_size > 0) {
      EXPECT_LE(segment.load_address + segment.file_size, kFlashSize);
    }
    if (segment.address < kRamStart) continue;
    EXPECT_LE(segment.address + segment.size, kRamEnd);
  }
}

TEST_F(TeensyImage, VectorsPointToTheStackAndIntoTheCode) {
  EXPECT_EQ(word_at(hex, 0), elf.symbols.at("_stack_top").value);
  EXPECT_GE(word_at(hex, 0), kRamStart + 4096);
  EXPECT_LE(word_at(hex, 0), kRamEnd);
  EXPECT_EQ(word_at(hex, 0) % 8, 0U);
  EXPECT_EQ(word_at(hex, 4), elf.symbols.at("reset_handler").value);
  // 16 of the core, 100 of the chip: all Thumb code within the image, behind the configuration field.
  for (std::uint32_t i = 1; i < 116; ++i) {
    const std::uint32_t vector = word_at(hex, 4 * i);
    EXPECT_EQ(vector & 1U, 1U) << i;
    EXPECT_GE(vector, 0x410U) << i;
    EXPECT_TRUE(hex.contains(vector & ~1U)) << i;
  }
}

TEST_F(TeensyImage, LeavesTheChipUnlocked) {
  EXPECT_EQ(elf.symbols.at("flash_config").value, 0x400U);
  for (std::uint32_t address = 0x400; address < 0x40C; ++address) EXPECT_EQ(hex.at(address), 0xFF) << address;
  const std::uint8_t security = hex.at(0x40C);
  EXPECT_EQ(security & 0x03, 0x02) << "SEC: anything but 10 secures the chip";
  EXPECT_EQ(security & 0x30, 0x10) << "MEEN: 10 would forbid the mass erase that unlocks it";
  EXPECT_EQ(security, 0xDE) << "as every Teensy program has it";
  EXPECT_EQ(hex.at(0x40D), 0xF9);
  EXPECT_EQ(hex.at(0x40E), 0xFF);
  EXPECT_EQ(hex.at(0x40F), 0xFF);
}

TEST_F(TeensyImage, HasNoHeapNoExceptionsAndNoSoftwareFloat) {
  const std::vector<std::string> forbidden = {"malloc",
                                              "_malloc_r",
                                              "free",
                                              "_sbrk",
                                              "sbrk",
                                              "calloc",
                                              "realloc",
                                              "_Znwj",
                                              "_ZdlPv",
                                              "_ZdlPvj",
                                              "abort",
                                              "__cxa_throw",
                                              "__cxa_guard_acquire",
                                              "__gxx_personality_v0",
                                              "_Unwind_Resume",
                                              "printf",
                                              "__cxa_atexit",
                                              "atexit"};
  for (const std::string& name : forbidden) EXPECT_FALSE(elf.symbols.contains(name)) << name;
  for (const auto& [name, symbol] : elf.symbols) {
    EXPECT_FALSE(name.starts_with("__aeabi_d") || name.starts_with("__aeabi_f") || name.starts_with("__aeabi_l2d") ||
                 name.starts_with("__aeabi_ul2") || name.starts_with("__aeabi_i2"))
        << name << ": double precision, or float, by software";
  }
}

TEST_F(TeensyImage, TheUsbTableIsWhereTheEngineCanFindIt) {
  for (const auto& [name, symbol] : elf.symbols) {
    if (name.find("5table") == std::string::npos) continue;
    EXPECT_EQ(symbol.value % 512, 0U);
    EXPECT_EQ(symbol.size, 5U * 4 * 8);
    return;
  }
  FAIL() << "no table";
}

// Without recursion and with one chain of calls, the stack is at most the sum of the largest frames on it;
// the emulated run (qemu_test.cpp) measures it.
TEST_F(TeensyImage, NoFunctionTakesMuchStack) {
  int files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(kFolder + "/isorig-teensy36.dir")) {
    if (entry.path().extension() != ".su") continue;
    ++files;
    std::ifstream file(entry.path());
    for (std::string line; std::getline(file, line);) {
      const std::size_t tab = line.find('\t');
      const std::size_t end = line.find('\t', tab + 1);
      const int bytes = std::stoi(line.substr(tab + 1, end - tab - 1));
      EXPECT_LE(bytes, 512) << line;
      EXPECT_EQ(line.substr(end + 1, 6), "static") << line << ": unbounded";
    }
  }
  EXPECT_GT(files, 8);
}

}  // namespace
}  // namespace isorig::firmware
