#include "drivers/config/register_map.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <fstream>
#include <ostream>
#include <sstream>
#include <string>
#include <string_view>

#include "drivers/config/modbus_config.hpp"
#include "tree.hpp"

namespace isorig::modbus {
namespace {

using testing::HasSubstr;

const std::filesystem::path kFrames = std::filesystem::path(test::source_path()) / "config/frames";

std::string text_of(const std::string& file) {
  std::ifstream in(kFrames / file);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

/// The shipped gateway map with one passage changed.
std::string gateway_with(const std::string& from, const std::string& to) {
  auto text = text_of("isorig-gateway.toml");
  const auto at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

std::string errors_of(const std::string& text) {
  try {
    (void)read_register_map(base::TomlDocument::parse_text(text, "map.toml"));
  } catch (const base::ConfigError& error) {
    return error.what();
  }
  return "no error";
}

TEST(RegisterMap, ShippedGatewayIsReadInOneBlock) {
  const auto map = read_register_map(kFrames / "isorig-gateway.toml");
  const auto header = map.header_block();
  EXPECT_EQ(header.address, 64);
  EXPECT_EQ(header.registers, 15);
  EXPECT_EQ(header.function, 4);
  EXPECT_EQ(header.quantities.size(), 10U);
  EXPECT_TRUE(map.state_blocks().empty());
  EXPECT_EQ(map.samples.stride_registers, 6);
  EXPECT_EQ(map.motion_of(2), frame::Motion::kReached);
  EXPECT_EQ(map.motion_of(99), frame::Motion::kFault) << "a state nobody named is not a good one";
}

TEST(RegisterMap, ShippedInt32MapCountsFromOneAndBridgesGaps) {
  const auto map = read_register_map(kFrames / "int32-scaled.toml");
  const auto header = map.header_block();
  EXPECT_EQ(header.address, 100);  // the manual's 101
  EXPECT_EQ(header.registers, 10);
  ASSERT_EQ(map.state_blocks().size(), 1U);
  EXPECT_EQ(map.state_blocks()[0].address, 200);
  EXPECT_EQ(map.state_blocks()[0].registers, 7);
  EXPECT_EQ(map.at(Quantity::kTarget_mm)->format.order, WordOrder::kCDAB);
  EXPECT_EQ(map.at(Quantity::kVelocity_mm_s)->format.order, WordOrder::kABCD);
  // 12.34567 mm in steps of 10 nm: 1234567 = 0x0012D687, low word first.
  const auto words = map.at(Quantity::kTarget_mm)->format.encode(12.34567);
  ASSERT_TRUE(words);
  EXPECT_EQ((*words)[0], 0xD687);
  EXPECT_EQ((*words)[1], 0x0012);
}

TEST(RegisterMap, FaultBitsAreRenamedAndUnknownOnesAreADriveFault) {
  const auto map = read_register_map(kFrames / "int32-scaled.toml");
  EXPECT_EQ(map.fault_bits_of(0x8001), frame::kHeartbeatLost | frame::kTravelLimit);
  EXPECT_EQ(map.fault_bits_of(0x0100), frame::kDriveFault);
  EXPECT_EQ(map.fault_word_of(frame::kForceLimit | frame::kDriveFault), 0x0082);
}

TEST(RegisterMap, SlotFollowsTheWriteIndex) {
  auto map = read_register_map(kFrames / "int32-scaled.toml");
  // 600 slots, index of the next to fill: the newest is the one before, across both wraps.
  EXPECT_EQ(map.slot_of(1000, 1000, 10), 9U);
  EXPECT_EQ(map.slot_of(990, 1000, 10), 599U);
  EXPECT_EQ(map.slot_of(0xFFFFFFFFU, 2, 10), 6U);
  map.samples.slot = SampleRing::Slot::kIndexOfNewest;
  EXPECT_EQ(map.slot_of(1000, 1000, 10), 10U);
}

TEST(RegisterMap, EveryErrorAtOnceWithItsPlace) {
  auto text =
      gateway_with("state = { address = 70, type = \"uint16\" }", "state = { address = 70, type = \"float16\" }");
  const std::string target = "target_mm = { address = 72, type = \"float32\" }";
  text.replace(text.find(target), target.size(), "target_mm = { address = 72, type = \"float32\", scael = 2.0 }");
  const auto errors = errors_of(text);
  const auto place_of = [&](std::string_view words) {
    const auto before = text.begin() + static_cast<std::ptrdiff_t>(text.find(words));
    return "map.toml:" + std::to_string(1 + std::count(text.begin(), before, '\n')) + ":";
  };
  EXPECT_THAT(errors, HasSubstr(place_of("float16")));
  EXPECT_THAT(errors, HasSubstr("float16"));
  EXPECT_THAT(errors, HasSubstr(place_of("scael")));
  EXPECT_THAT(errors, HasSubstr("did you mean `scale`?"));
}

struct BadMap {
  const char* from;
  const char* to;
  const char* says;
};

/// Its reason, as a test can be called.
void PrintTo(const BadMap& map, std::ostream* out) {
  for (const char c : std::string_view(map.says)) *out << (std::isalnum(static_cast<unsigned char>(c)) != 0 ? c : '_');
}

class BadMaps : public testing::TestWithParam<BadMap> {};

TEST_P(BadMaps, AreRefusedWithAReason) {
  EXPECT_THAT(errors_of(gateway_with(GetParam().from, GetParam().to)), HasSubstr(GetParam().says));
}

INSTANTIATE_TEST_SUITE_P(
    RegisterMap, BadMaps,
    testing::Values(
        BadMap{"command = { address = 5", "# command = { address = 5", "`command` is missing"},
        BadMap{"heartbeat = { address = 6,", "heartbeat = { address = 5,", "`command` overlaps `heartbeat`"},
        BadMap{"command = { address = 5", "command = { address = 4", "`command` overlaps `segment_id_setpoint`"},
        BadMap{"slots = 1024", "slots = 1000", "no power of two"},
        BadMap{"slot_is = \"counter_modulo_slots\"", "slot_is = \"index_of_next\"", "needs `write_index`"},
        BadMap{"stride_registers = 6", "stride_registers = 5", "the field ends after the slot's 5 registers"},
        BadMap{"target_setpoint_mm = { address = 0, type = \"float32\" }",
               "target_setpoint_mm = { address = 0, type = \"float32\", write_function = 6 }",
               "set write_function = 16"},
        BadMap{"device_time_us = { address = 66, type = \"uint32\" }",
               "device_time_us = { address = 166, type = \"uint32\" }", "cannot be read in one request"},
        BadMap{"sample_counter = { address = 64, type = \"uint32\" }",
               "sample_counter = { address = 64, type = \"float32\" }", "counted and wraps"},
        BadMap{"address = 256", "address = 70", "lies in [samples]"},
        BadMap{"address = 256", "address = 60000", "outside the 65536 registers"},
        BadMap{"reached = 2\n", "reached = 1\n", "two states have the code 1"},
        BadMap{"stop = 2", "stop = 1", "the same command"},
        BadMap{"read_function = 4", "read_function = 5", "it has to be 3 or 4"},
        BadMap{"word_order = \"ABCD\"", "word_order = \"ACBD\"", "\"CDAB\""},
        BadMap{"max_read_registers = 125", "max_read_registers = 126", "from 2 to 125"}));

TEST(ModbusConfig, ReadsARigsFrameTable) {
  const auto document = base::TomlDocument::parse_text(
      "map = \"isorig-gateway.toml\"\ntransport = \"rtu\"\ntty = \"/dev/ttyUSB0\"\nbaud = 921600\n"
      "parity = \"even\"\nresponse_timeout_ms = 40\nserial = \"A7\"\n",
      "rig.toml");
  const auto config = read_modbus_config(document.root(), kFrames);
  document.finish();
  EXPECT_EQ(config.transport, ModbusTransport::kRtu);
  EXPECT_EQ(config.parity, 'E');
  EXPECT_EQ(config.response_timeout_ms, 40);
  EXPECT_EQ(config.expected_serial, "A7");
  EXPECT_EQ(config.where(), "rtu /dev/ttyUSB0");
}

TEST(ModbusConfig, ATextTheMapDoesNotHaveCannotBeExpected) {
  const auto document = base::TomlDocument::parse_text(
      "map = \"int32-scaled.toml\"\ntransport = \"tcp\"\nhost = \"127.0.0.1\"\nport = 502\nmodel = "
      "\"5969\"\n",
      "rig.toml");
  (void)read_modbus_config(document.root(), kFrames);
  const auto diagnostics = document.diagnostics();
  ASSERT_EQ(diagnostics.size(), 1U);
  EXPECT_THAT(diagnostics[0].text(), HasSubstr("rig.toml:5:"));
  EXPECT_THAT(diagnostics[0].text(), HasSubstr("cannot be checked"));
}

}  // namespace
}  // namespace isorig::modbus
