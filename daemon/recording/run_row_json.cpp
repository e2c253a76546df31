#include "daemon/recording/run_row_json.hpp"

namespace isorig::daemon {

nlohmann::ordered_json row_json(const RunRow& row) {
  return {{"id", row.id},
          {"started_utc", row.started_utc},
          {"state", row.state},
          {"fault", row.fault},
          {"specimen", row.specimen},
          {"rig", row.rig},
          {"protocol", row.protocol},
          {"operator", row.operator_name},
          {"attempts", row.attempts},
          {"sessions", row.sessions},
          {"sessions_done", row.sessions_done},
          {"recorded_s", row.recorded_s},
          {"directory", row.directory.string()}};
}

}  // namespace isorig::daemon
