#pragma once
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "identify/report/figure.hpp"

namespace isorig::identify::report {

/// A page for people that needs nothing but itself: style, figures (inline SVG) and tables in one file, no
/// script, no network. Text given to it is plain; it is escaped here.
class Page {
 public:
  explicit Page(std::string title);

  void heading(std::string_view text);  ///< a section
  void subheading(std::string_view text);
  void paragraph(std::string_view text);
  void note(std::string_view text);  ///< set apart: a warning, a limit, what is simulated
  void list(const std::vector<std::string>& items);
  /// Cells that read as numbers are set flush right. Rows may be shorter than the header.
  void table(const std::vector<std::string>& header, const std::vector<std::vector<std::string>>& rows,
             std::string_view caption = {});
  /// Remembers the figure and its place; drawn by write().
  void figure(Figure figure);

  /// Draws all figures into `folder`/figures and writes `folder`/`file_name` (through a temporary name).
  /// Throws what draw() throws, and std::filesystem::filesystem_error or std::runtime_error when it cannot
  /// write.
  void write(const std::filesystem::path& folder, const DrawOptions& options = {},
             std::string_view file_name = "report.html") const;

 private:
  struct Block {
    std::string html;
    int figure = -1;  ///< index; html unused
  };
  std::string title_;
  std::vector<Block> blocks_;
  std::vector<Figure> figures_;
};

/// &, <, >, " as entities.
[[nodiscard]] std::string escaped(std::string_view text);

/// "1.234" with `digits` significant digits; "-" for NaN.
[[nodiscard]] std::string number_text(double value, int digits = 4);

/// "1.23 [1.10, 1.36]", digits by the width of the interval; an end that is not finite is "..".
[[nodiscard]] std::string interval_text(double value, double low, double high);

/// Writes text through a temporary name in the same folder, so that a reader never sees half of it.
void write_text_file(const std::filesystem::path& file, std::string_view text);

}  // namespace isorig::identify::report
