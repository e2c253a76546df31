#include "identify/pooling/campaign_grid.hpp"

#include <algorithm>
#include <cctype>
#include <set>

#include "base/formatted.hpp"

namespace isorig::identify::pooling {
namespace {

report::GridCell mark_of(NoAnswer why) {
  switch (why) {
    case NoAnswer::kLeftOut:
      return {"○", -1, {}, "answered, and in no pool"};
    case NoAnswer::kUnreadable:
      return {"!", 7, {}, "cannot be read"};
    case NoAnswer::kFailed:
      return {"×", 7, {}, "failed"};
    case NoAnswer::kWaiting:
      break;
  }
  return {"…", -1, {}, "not made yet"};
}

}  // namespace

bool counts_before(const std::string& a, const std::string& b) {
  std::size_t i = 0, j = 0;
  const auto digit = [](char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; };
  while (i < a.size() && j < b.size()) {
    if (digit(a[i]) && digit(b[j])) {
      std::size_t k = i, l = j;
      while (k < a.size() && digit(a[k])) ++k;
      while (l < b.size() && digit(b[l])) ++l;
      while (i + 1 < k && a[i] == '0') ++i;
      while (j + 1 < l && b[j] == '0') ++j;
      if (k - i != l - j) return k - i < l - j;
      if (const int order = a.compare(i, k - i, b, j, l - j); order != 0) return order < 0;
      i = k;
      j = l;
    } else if (a[i] != b[j]) {
      return a[i] < b[j];
    } else {
      ++i;
      ++j;
    }
  }
  return a.size() - i < b.size() - j;
}

void CampaignGrid::add(const std::string& specimen, double pressure_psi, report::GridCell cell) {
  rows_[specimen][pressure_psi].push_back(std::move(cell));
}

void CampaignGrid::add(const NotPooled& recording) {
  report::GridCell mark = mark_of(recording.why);
  key(mark);
  mark.title = recording.title;
  mark.href = recording.href;
  add(recording.specimen, recording.pressure_psi, std::move(mark));
}

void CampaignGrid::key(const report::GridCell& mark) {
  if (std::ranges::find(key_, mark.text, &report::GridCell::text) == key_.end()) key_.push_back(mark);
}

report::Grid CampaignGrid::grid() const {
  std::set<double> pressures;
  for (const auto& [specimen, places] : rows_)
    for (const auto& [pressure_psi, cells] : places) pressures.insert(pressure_psi);
  report::Grid out;
  out.caption = caption_;
  out.key = key_;
  for (const double pressure_psi : pressures) out.columns.push_back(base::formatted("%g psi", pressure_psi));
  for (const auto& [specimen, places] : rows_) {
    out.rows.push_back({specimen, {}});
    for (const double pressure_psi : pressures) {
      const auto at = places.find(pressure_psi);
      out.rows.back().cells.push_back(at == places.end() ? std::vector<report::GridCell>() : at->second);
    }
  }
  return out;
}

}  // namespace isorig::identify::pooling
