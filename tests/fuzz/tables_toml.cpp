// The smaller files: specimen (for the daemon and for the simulation), calibration record, register map, regulator,
// mapping of an import, amendments, recording.toml. Each reader is given every input that is TOML. What is none each of
// them has refused by the parser that they share: one is asked then, which one follows from the length.
#include <array>

#include "calibration/record.hpp"
#include "daemon/recording/amendments.hpp"
#include "daemon/rig/specimen.hpp"
#include "drivers/config/register_map.hpp"
#include "drivers/config/regulator_config.hpp"
#include "messages/foreign/mapping.hpp"
#include "messages/recording.hpp"
#include "sim/specimen.hpp"
#include "target.hpp"

namespace {

using namespace isorig;

/// An input as text and in a file that some readers find by its name.
struct Given {
  std::string text;
  std::filesystem::path file = fuzz::scratch() / "amendments.toml";
};

constexpr std::array<void (*)(const Given&), 8> kReaders{
    [](const Given& given) {
      const auto specimen = daemon::parse_specimen(given.text, "specimen.toml");
      for (const double psi : {0.0, 5.0, 20.0, 30.0}) (void)specimen.pressurized_rest_length_mm(psi);
    },
    [](const Given& given) { (void)sim::load_specimen(given.file); },
    [](const Given& given) {
      const auto record = calibration::parse_record(given.text, "record.toml");
      // What was taken can be written, and is taken again.
      fuzz::require(calibration::parse_record(calibration::to_toml(record), "again.toml").id == record.id,
                    "a record is another one when it is read back");
    },
    [](const Given& given) {
      const auto map = modbus::read_register_map(base::TomlDocument::parse_text(given.text, "map.toml"));
      fuzz::require(map.header_block().registers <= map.max_read_registers, "a block longer than a request may be");
      (void)map.state_blocks();
    },
    [](const Given& given) { (void)pressure::read_regulator_map(given.file); },
    [](const Given& given) {
      const auto mapping = foreign::read_mapping(given.file);
      fuzz::require(!foreign::mapping_text(mapping).empty(), "a mapping without words");
    },
    [](const Given& given) { (void)daemon::read_amendments(given.file.parent_path()); },
    [](const Given& given) { (void)messages::read_recording_toml(given.file); },
};

void attempt(void (*read)(const Given&), const Given& given) {
  try {
    read(given);
  } catch (const base::ConfigError& error) {
    fuzz::refused(error);
  } catch (const messages::RecordingError& error) {
    fuzz::refused(error.what());
  }
}

bool is_toml(const std::string& text) {
  try {
    (void)base::TomlDocument::parse_text(text, "any.toml");
    return true;
  } catch (const base::ConfigError&) {
    return false;
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static Given given;
  given.text = fuzz::text({data, size});
  fuzz::put(given.file, given.text);
  if (!is_toml(given.text)) {
    attempt(kReaders[size % kReaders.size()], given);
    return 0;
  }
  for (const auto read : kReaders) attempt(read, given);
  return 0;
}
