// The segments of a run: the reader, the verdict on the recording, the first pass of an export, and the export itself.
// First byte: 1 seals each event with a right checksum, so that what is inside is read; 2 exports; 4 a lone segment.
// Then the segments, divided by lines of "%%%%".
#include "messages/run_log.hpp"

#include <vector>

#include "daemon/export/export.hpp"
#include "daemon/export/scan.hpp"
#include "messages/crc32c.hpp"
#include "messages/log_event.hpp"
#include "target.hpp"

namespace {

using namespace isorig;

std::vector<std::uint8_t> sealed(fuzz::Bytes bytes) {
  std::vector<std::uint8_t> log(bytes.begin(), bytes.end());
  for (std::size_t at = 0; at + messages::kLogHeaderBytes <= log.size();) {
    if (messages::big_endian(&log[at], 4) != messages::kLogSyncWord) {
      ++at;
      continue;
    }
    const auto channel = messages::big_endian(&log[at + 20], 4), data = messages::big_endian(&log[at + 24], 4);
    const auto end = at + messages::kLogHeaderBytes + channel + data;
    if (end > log.size() || data < messages::kLogChecksumBytes) {
      ++at;
      continue;
    }
    messages::put_big_endian(&log[end - messages::kLogChecksumBytes],
                             messages::crc32c({&log[at], end - messages::kLogChecksumBytes - at}));
    at = end;
  }
  return log;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const auto folder = [] {
    auto made = fuzz::scratch() / "run";
    std::filesystem::create_directory(made);
    return made;
  }();
  fuzz::Input in(data, size);
  const auto how = in.byte();
  const auto out = fuzz::scratch() / "out";
  int segments = 0;
  while (!in.empty() && segments < 4) {
    const auto part = in.part();
    const auto file = folder / messages::segment_name(++segments);
    if ((how & 1U) != 0) {
      const auto log = sealed(part);
      fuzz::put(file, fuzz::text(log));
    } else {
      fuzz::put(file, fuzz::text(part));
    }
  }
  for (int gone = segments + 1; gone <= 4; ++gone) std::filesystem::remove(folder / messages::segment_name(gone));
  if (segments == 0) return 0;
  const auto run = (how & 4U) != 0 ? folder / messages::segment_name(1) : folder;
  daemon::Scan scan;
  try {
    const auto report = messages::read_run(run, scan);
    if (report.state() != messages::RecordingState::kWhole)
      fuzz::require(!report.complaints().empty(), "a recording that is not whole, and no complaint");
    for (const auto& complaint : report.complaints()) fuzz::refused(complaint);
    (void)messages::read_header(folder / messages::segment_name(1));
  } catch (const messages::UnknownLogVersion& error) {
    fuzz::refused(error.what());
  }
  if ((how & 2U) == 0) return 0;
  try {
    (void)daemon::export_run(run, out, {.specimen = "one", .rest_length_mm = 100.0, .remap = (how & 8U) != 0});
  } catch (const std::runtime_error& error) {
    fuzz::refused(error.what());
  }
  std::filesystem::remove_all(out);
  return 0;
}
