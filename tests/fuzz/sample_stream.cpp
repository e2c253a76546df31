// What isorig-web reads from the daemon: records in pieces of any size.
#include "daemon/recording/sample_stream.hpp"

#include "target.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isorig;
  fuzz::Input in(data, size);
  const std::size_t piece = in.byte() + 1U;
  daemon::samples::Reader reader;
  daemon::samples::Record record;
  try {
    while (!in.empty()) {
      reader.feed(fuzz::text(in.take(piece)));
      while (reader.next(record)) {
        std::string again;
        std::visit([&](const auto& each) { daemon::samples::append(again, each); }, record);
        fuzz::require(again.size() <= daemon::samples::kMaxRecordBytes, "a record longer than the longest");
      }
    }
  } catch (const daemon::samples::StreamError& error) {
    fuzz::refused(error.what());
  }
  return 0;
}
