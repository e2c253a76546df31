// A folder in the recording format: recording.toml, frame.csv and pressure.csv, divided by lines of "%%%%".
#include "messages/recording.hpp"

#include "messages/recording_id.hpp"
#include "target.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isorig;
  static const auto folder = [] {
    auto made = fuzz::scratch() / "recording";
    std::filesystem::create_directory(made);
    return made;
  }();
  fuzz::Input in(data, size);
  fuzz::put(folder / "recording.toml", fuzz::text(in.part()));
  fuzz::put(folder / "frame.csv", fuzz::text(in.part()));
  const bool pneumatic = !in.empty();
  if (pneumatic) {
    fuzz::put(folder / "pressure.csv", fuzz::text(in.part()));
  } else {
    std::filesystem::remove(folder / "pressure.csv");
  }
  try {
    const auto recording = messages::read_recording(folder);
    fuzz::require(recording.frame.size() > 0 && recording.pressure.has_value() == pneumatic, "half a recording");
    (void)messages::recording_id(recording);
    // What was read can be written, and is read again as it was.
    messages::write_recording(folder, recording);
    const auto again = messages::read_recording(folder);
    fuzz::require(again.frame.t_s == recording.frame.t_s && again.frame.force_N == recording.frame.force_N &&
                      again.frame.position_mm == recording.frame.position_mm &&
                      again.metadata.specimen == recording.metadata.specimen,
                  "a recording is another one when it is read back");
  } catch (const messages::RecordingError& error) {
    fuzz::refused(error.what());
  }
  return 0;
}
