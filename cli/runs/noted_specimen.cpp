#include "cli/runs/noted_specimen.hpp"

#include "base/printable.hpp"
#include "daemon/recording/amendments.hpp"
#include "daemon/rig/specimen.hpp"

namespace isorig::cli {

std::optional<daemon::ExportOptions::Noted> noted_specimen(const std::filesystem::path& run, std::string& words) {
  const auto amendments = daemon::shown_amendments(run);
  const daemon::Amendment* last = daemon::last_of_specimen(amendments);
  if (last == nullptr) return std::nullopt;
  daemon::ExportOptions::Noted noted{.specimen = last->specimen};
  words = "by a note of " + base::printable(last->at_utc) + " the specimen is " + base::printable(last->specimen);
  if (last->specimen_file.empty()) {
    words += "; the note has no lengths of it, so that recording.toml has none: state them there";
    return noted;
  }
  const auto specimen = daemon::parse_specimen(last->specimen_file, last->specimen);
  noted.rest_length_mm = specimen.rest_length_mm;
  noted.pressurized_rest_length_mm = [specimen](double psi) { return specimen.pressurized_rest_length_mm(psi); };
  words += ", and its lengths are those of the note";
  return noted;
}

}  // namespace isorig::cli
