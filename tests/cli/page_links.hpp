#pragma once
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <vector>

/// Where a report page leads.
namespace isorig::pieces_test {

/// The page's content, isorig-report-data/1.
inline nlohmann::json page_data(const std::filesystem::path& page) {
  std::ifstream in(page, std::ios::binary);
  const std::string html(std::istreambuf_iterator<char>(in), {});
  const auto begin = html.find(R"({"format":"isorig-report-data/1")"), end = html.find("</script>", begin);
  if (begin == std::string::npos || end == std::string::npos) throw std::runtime_error(page.string() + ": no data");
  return nlohmann::json::parse(html.substr(begin, end - begin));
}

/// The first block of a page with this type, and for a table with this first column; null without one.
inline nlohmann::json block_of(const nlohmann::json& page, const std::string& type, const std::string& column = "") {
  for (const auto& block : page.at("blocks"))
    if (block.at("type") == type && (column.empty() || block.at("columns").at(0).at("name") == column)) return block;
  return nullptr;
}

inline void add_links(const nlohmann::json& part, std::vector<std::string>& out) {
  if (part.is_object())
    for (const auto& [key, value] : part.items()) {
      if (key == "href") out.push_back(value);
      if (key == "hrefs")
        for (const auto& row : value)
          for (const auto& cell : row)
            if (cell != "") out.push_back(cell);
      add_links(value, out);
    }
  if (part.is_array())
    for (const auto& one : part) add_links(one, out);
}

inline std::vector<std::string> links_in(const nlohmann::json& part) {
  std::vector<std::string> out;
  add_links(part, out);
  return out;
}

/// Those that lead to no file.
inline std::vector<std::string> broken_links(const std::filesystem::path& page) {
  std::vector<std::string> out;
  for (const std::string& link : links_in(page_data(page))) {
    std::string path;
    for (std::size_t i = 0; i < link.size(); ++i) {
      const bool coded = link[i] == '%' && i + 2 < link.size();
      path += coded ? static_cast<char>(std::strtol(link.substr(i + 1, 2).c_str(), nullptr, 16)) : link[i];
      if (coded) i += 2;
    }
    if (!std::filesystem::exists(page.parent_path() / path)) out.push_back(link);
  }
  return out;
}

}  // namespace isorig::pieces_test
