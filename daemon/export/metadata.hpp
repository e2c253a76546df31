#pragma once
#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "daemon/export/export.hpp"
#include "daemon/export/scan.hpp"
#include "daemon/export/writer.hpp"

/// What an export says of a session beside its rows: recording.toml, and the same as attributes.
namespace isorig::daemon {

struct Provenance {
  const ExportOptions* options = nullptr;
  const isorig_msgs::run_header_t* header = nullptr;
  messages::RecordingState state{};
  std::vector<std::string> complaints;
};

/// `start_ns`: where t_s is 0.
void describe_session(SessionTail& tail, const Provenance& from, const isorig_msgs::session_t& planned,
                      const ExportedSession& e, const SessionMarks& marks, std::int64_t start_ns);

/// Of the run as a whole.
[[nodiscard]] Attributes describe_run(const Provenance& from);

/// "rep-1_05-psi": names of a plan's sessions sort as their numbers do, whatever sorts them. Made from the whole plan:
/// a session has the same name however many of the others have samples yet.
class SessionNames {
 public:
  explicit SessionNames(const std::vector<isorig_msgs::session_t>& planned);
  /// Throws std::out_of_range for a session that was not planned.
  [[nodiscard]] const std::string& of(std::int32_t session) const { return name_of_.at(session); }
  [[nodiscard]] bool knows(std::int32_t session) const { return name_of_.contains(session); }
  /// Names that an export of some of the plan's sessions alone would have given it, were they not those of others.
  [[nodiscard]] std::set<std::string> former(const isorig_msgs::session_t& planned) const;

 private:
  int repetition_digits_ = 1, pressure_digits_ = 1;
  std::map<std::int32_t, std::string> name_of_;
  std::set<std::string> taken_;
};

}  // namespace isorig::daemon
