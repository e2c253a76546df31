#pragma once
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "identify/report/page.hpp"

namespace isorig::identify::pooling {

/// "Actuator10" after "Actuator9": stretches of digits count as numbers.
[[nodiscard]] bool counts_before(const std::string& a, const std::string& b);

/// Why a recording of a campaign says nothing in its pool.
enum class NoAnswer {
  kLeftOut,     ///< answered, and not to be pooled
  kUnreadable,  ///< the recording cannot be read
  kFailed,
  kWaiting,
};

/// A recording that is in no pool, for its cell of the grid.
struct NotPooled {
  std::string specimen;
  double pressure_psi = 0.0;
  NoAnswer why = NoAnswer::kWaiting;
  std::string title;   ///< in full
  std::string href{};  ///< relative to the page; empty: it leads nowhere
};

/// Specimens by pressures, several recordings in a place. Rows in the order that people count in, pressures rising,
/// recordings of a place in the order in which they were added.
class CampaignGrid {
 public:
  explicit CampaignGrid(std::string caption) : caption_(std::move(caption)) {}
  void add(const std::string& specimen, double pressure_psi, report::GridCell cell);
  /// With its mark, which the key then has.
  void add(const NotPooled& recording);
  /// What a mark means (its title), once for each text.
  void key(const report::GridCell& mark);
  [[nodiscard]] bool empty() const { return rows_.empty(); }
  [[nodiscard]] report::Grid grid() const;

 private:
  struct Before {
    bool operator()(const std::string& a, const std::string& b) const {
      return counts_before(a, b) || (!counts_before(b, a) && a < b);  // "A1" and "A01" are two
    }
  };
  std::string caption_;
  std::map<std::string, std::map<double, std::vector<report::GridCell>>, Before> rows_;
  std::vector<report::GridCell> key_;
};

}  // namespace isorig::identify::pooling
