#pragma once
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include "cli/campaign/curves.hpp"
#include "cli/campaign/merge.hpp"
#include "identify/pooling/pool.hpp"
#include "identify/report/page.hpp"

namespace isorig::cli::pieces {

/// What the diagnoses say together, or why they cannot be put together.
struct Together {
  std::optional<identify::pooling::PooledCampaign> pooled;
  std::string why;
};

/// Repetitions of all specimens are called alike: the folder that a recording lies in tells them apart.
[[nodiscard]] std::string short_name(const std::filesystem::path& recording);

/// DIR/campaign-report.html, collected row by row and of bounded size.
class CampaignPage {
 public:
  explicit CampaignPage(const Plan& plan) : plan_(plan) {}
  void add(const nlohmann::ordered_json& row);
  [[nodiscard]] const Curves& curves() const { return curves_; }
  void write(const Standing& standing, const Together& together, const identify::report::Made& made) const;

 private:
  using Cells = std::vector<identify::report::GridCell>;
  [[nodiscard]] std::string page_of(const nlohmann::ordered_json& row) const;
  void add_row(const nlohmann::ordered_json& row, const std::string& where);
  void add_cell(const nlohmann::ordered_json& row, const std::string& where);
  void write_grid(identify::report::Page& page) const;
  void write_rows(identify::report::Page& page, const Standing& standing, bool pooled) const;

  const Plan& plan_;
  std::vector<std::vector<std::string>> rows_, hrefs_;
  std::map<std::tuple<std::string, double>, Cells> cells_;  ///< of what is answered
  std::vector<identify::pooling::NotPooled> not_answered_;  ///< unreadable, failed, waiting
  Curves curves_;
  bool all_rows_ = true, all_cells_ = true;
};

}  // namespace isorig::cli::pieces
