#pragma once
#include <filesystem>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "identify/report/figure.hpp"

namespace isorig::identify::report {

/// How good or bad news are: shown by colour and by place, never by colour alone.
enum class Mood { kGood, kInfo, kWarning, kBad };

/// How a page came about, at its foot.
struct Made {
  std::string command;  ///< as it was typed
  std::string version;
  std::string at_utc;                                         ///< empty: now
  std::vector<std::pair<std::string, std::string>> inputs{};  ///< what, and which
  std::vector<std::pair<std::string, std::string>> links{};   ///< neighbours: text, path relative to the page
  bool undated = false;  ///< no time on the page: the same content gives the same bytes
};

struct Fact {
  std::string name, value;
  std::string note{};
  std::optional<Mood> mood{};
};

/// A cell of a Grid: a letter or a word, a colour of the palette (0 to 7; -1: none), where it leads, and what it says
/// in full.
struct GridCell {
  std::string text;
  int color = -1;
  std::string href{};
  std::string title{};
};

/// Many small answers on one page: rows by columns, several in a place, and the key of their letters.
struct Grid {
  std::string caption{};
  std::vector<std::string> columns{};
  struct Row {
    std::string name;
    std::vector<std::vector<GridCell>> cells;  ///< one list for each column
  };
  std::vector<Row> rows{};
  std::vector<GridCell> key{};
};

/// A page for people that needs nothing but itself: the template of web/ with the content as JSON in it. One file, no
/// network, printable. Text given to it is plain.
class Page {
 public:
  /// `kind`: what sort of page, above the title ("Diagnosis").
  Page(std::string_view kind, std::string_view title);
  ~Page();
  Page(const Page&) = delete;
  Page& operator=(const Page&) = delete;

  void subtitle(std::string_view text);
  /// What it comes to, in one sentence, before everything else. `word`: the sentence in one or two words.
  void lead(Mood mood, std::string_view word, std::string_view text);
  void made(const Made& made);
  /// A neighbour, by its path relative to this page; Made brings others.
  void link(std::string_view text, std::string_view href);

  void heading(std::string_view text);  ///< a section
  void subheading(std::string_view text);
  void paragraph(std::string_view text);
  void note(std::string_view text, Mood mood = Mood::kWarning);  ///< set apart: a warning, a limit, what is simulated
  void equation(std::string_view text);
  void code(std::string_view name, std::string_view text);  ///< a file, as it is
  void list(const std::vector<std::string>& items);
  void facts(const std::vector<Fact>& items);
  /// A column whose cells all read as numbers is set flush right, its head too. Rows may be shorter than the header.
  /// `hrefs`: of each cell where it leads, as a path relative to the page (as_link() of neighbours.hpp); may be
  /// shorter.
  void table(const std::vector<std::string>& header, const std::vector<std::vector<std::string>>& rows,
             std::string_view caption = {}, const std::vector<std::vector<std::string>>& hrefs = {});
  void grid(const Grid& grid);        ///< links are paths relative to the page
  void figure(const Figure& figure);  ///< throws what figure_json() throws

  /// What follows is folded away behind `summary` until end_more(): for those who want all of it.
  void begin_more(std::string_view summary);
  void end_more();

  /// isorig-report-data/1 (web/src/report/document.ts).
  [[nodiscard]] nlohmann::ordered_json json() const;
  /// With links to its neighbours that are there (neighbours.hpp), and the runs that its inputs were recorded in.
  /// Through a temporary name. Throws std::filesystem::filesystem_error or std::runtime_error when it cannot write.
  void write(const std::filesystem::path& folder, std::string_view file_name) const;

 private:
  struct Content;
  void add(nlohmann::ordered_json block);
  std::unique_ptr<Content> content_;
};

/// Now, "2026-03-01 14:05 UTC", for Made.
[[nodiscard]] std::string now_utc();

/// &, <, >, " as entities.
[[nodiscard]] std::string escaped(std::string_view text);

/// "1.234" with `digits` significant digits; "-" for NaN.
[[nodiscard]] std::string number_text(double value, int digits = 4);

/// "1.23 [1.10, 1.36]", digits by the width of the interval; an end that is not finite is "..".
[[nodiscard]] std::string interval_text(double value, double low, double high);

/// R² with the digits that mean something: as many as tell it from 1, "0.99987", at most "> 0.999999".
[[nodiscard]] std::string r_squared_text(double value);

}  // namespace isorig::identify::report
