#include "cli/analysis/analyse_recordings.hpp"

#include <filesystem>
#include <iostream>
#include <optional>
#include <stdexcept>
#include <utility>

#include "base/printable.hpp"
#include "cli/screen/exit_codes.hpp"
#include "cli/screen/progress.hpp"

namespace isorig::cli {

AnalysedRecordings analyse_recordings(const std::string& command, const std::vector<std::string>& paths,
                                      double read_share, identify::FvOptions options, const CheckRecording& check,
                                      Unreadable unreadable) {
  AnalysedRecordings out;
  const auto cannot_be_read = [&](const std::string& path, const std::string& why) {
    std::cerr << why << '\n';
    out.left_out.push_back({path, why});
  };
  std::vector<std::filesystem::path> files;
  files.reserve(paths.size());
  for (const auto& path : paths) files.push_back(std::filesystem::path(path) / "frame.csv");
  std::optional<FilesProgress> progress(std::in_place, command, files);
  for (std::size_t i = 0; i < paths.size(); ++i) {
    const std::string& path = paths[i];
    progress->at(i, 0.0, path);
    try {
      const auto recording = messages::read_recording(path);
      progress->at(i, read_share, path);
      if (check) check(recording, path);
      options.on_progress = [&](double done) { progress->at(i, read_share + (1.0 - read_share) * done, path); };
      out.results.push_back(identify::analyse_recording(recording, path, options));
    } catch (const std::invalid_argument& e) {
      cannot_be_read(path, base::printable_lines(e.what()));
    } catch (const messages::RecordingError& e) {
      cannot_be_read(path, e.what());
    }
  }
  progress.reset();
  if (!out.left_out.empty() && (unreadable == Unreadable::kRefuse || out.results.empty())) {
    out.exit_code = kBadInput;
    return out;
  }
  for (const auto& line : identify::repeated_recordings(out.results)) {
    std::cerr << "isorig " << command << ": " << line << '\n';
    out.exit_code = kUsage;
  }
  return out;
}

}  // namespace isorig::cli
