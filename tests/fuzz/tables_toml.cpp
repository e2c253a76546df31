// The smaller files: specimen (for the daemon and for the simulation), calibration record, register map, regulator,
// mapping of an import, amendments, recording.toml. Each reader is given every input.
#include <functional>

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

void attempt(const std::function<void()>& read) {
  try {
    read();
  } catch (const base::ConfigError& error) {
    fuzz::refused(error);
  } catch (const messages::RecordingError& error) {
    fuzz::refused(error.what());
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string text(fuzz::text({data, size}));
  const auto file = fuzz::scratch() / "amendments.toml";
  fuzz::put(file, text);
  attempt([&] {
    const auto specimen = daemon::parse_specimen(text, "specimen.toml");
    for (const double psi : {0.0, 5.0, 20.0, 30.0}) (void)specimen.pressurized_rest_length_mm(psi);
  });
  attempt([&] { (void)sim::load_specimen(file); });
  attempt([&] {
    const auto record = calibration::parse_record(text, "record.toml");
    // What was taken can be written, and is taken again.
    fuzz::require(calibration::parse_record(calibration::to_toml(record), "again.toml").id == record.id,
                  "a record is another one when it is read back");
  });
  attempt([&] {
    const auto map = modbus::read_register_map(base::TomlDocument::parse_text(text, "map.toml"));
    fuzz::require(map.header_block().registers <= map.max_read_registers, "a block longer than a request may be");
    (void)map.state_blocks();
  });
  attempt([&] { (void)pressure::read_regulator_map(file); });
  attempt([&] {
    const auto mapping = foreign::read_mapping(file);
    fuzz::require(!foreign::mapping_text(mapping).empty(), "a mapping without words");
  });
  attempt([&] { (void)daemon::read_amendments(file.parent_path()); });
  attempt([&] { (void)messages::read_recording_toml(file); });
  return 0;
}
