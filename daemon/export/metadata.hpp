#pragma once
#include <cstdint>
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

/// "rep-1_05-psi": names of a plan's sessions sort as their numbers do, whatever sorts them.
class SessionNames {
 public:
  explicit SessionNames(const std::vector<isorig_msgs::session_t>& planned);
  [[nodiscard]] std::string of(std::int32_t session, std::int32_t repetition, double pressure_psi);

 private:
  int repetition_digits_ = 1, pressure_digits_ = 1;
  std::map<std::string, std::int32_t> taken_;
};

}  // namespace isorig::daemon
