#include "identify/report/figure.hpp"

#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <sstream>
#include <stdexcept>

namespace isorig::identify::report {
namespace {

constexpr std::array kPalette{"#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#999999"};

/// In single quotes gnuplot takes everything as it is (in double quotes it would run `commands`).
std::string gnuplot_literal(std::string_view text) {
  std::string out = "'";
  for (char c : text) {
    if (static_cast<unsigned char>(c) < 0x20)
      out += ' ';
    else if (c == '\'')
      out += "''";
    else
      out += c;
  }
  return out + "'";
}

void check(const Figure& figure) {
  auto refuse = [&](const std::string& why) { throw std::invalid_argument("figure '" + figure.name + "': " + why); };
  if (figure.name.empty() || figure.name.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"
                                                           "0123456789-_") != std::string::npos)
    refuse("a name is made of letters, digits, '-' and '_'");
  if (figure.panels.empty()) refuse("no panels");
  if (figure.columns < 1) refuse("columns must be at least 1");
  for (const Panel& panel : figure.panels)
    for (const Series& s : panel.series) {
      if (s.x.size() != s.y.size()) refuse("x and y have different lengths");
      if (!s.error.empty() && s.error.size() != s.x.size()) refuse("error and x have different lengths");
      if (s.mark == Mark::kBand && s.y2.size() != s.x.size()) refuse("y2 and x have different lengths");
    }
}

void number(std::ostream& out, double value) {
  std::array<char, 32> text{};
  if (std::isfinite(value))
    std::snprintf(text.data(), text.size(), "%.7g", value);
  else
    std::snprintf(text.data(), text.size(), "NaN");
  out << text.data();
}

void write_data(std::ostream& out, const Figure& figure) {
  for (std::size_t p = 0; p < figure.panels.size(); ++p)
    for (std::size_t k = 0; k < figure.panels[p].series.size(); ++k) {
      const Series& s = figure.panels[p].series[k];
      out << "$d" << p << '_' << k << " << EOD\n";
      for (std::size_t i = 0; i < s.x.size(); ++i) {
        number(out, s.x[i]);
        out << ' ';
        number(out, s.y[i]);
        if (s.mark == Mark::kBand) {
          out << ' ';
          number(out, s.y2[i]);
        } else if (!s.error.empty()) {
          out << ' ';
          number(out, s.error[i]);
        }
        out << '\n';
      }
      out << "EOD\n";
    }
}

void plot_elements(std::ostream& out, const Panel& panel, std::size_t p) {
  const char* joint = "plot ";
  int next_color = 0;
  auto element = [&](std::size_t k, const std::string& how, std::string_view title) {
    out << joint << "$d" << p << '_' << k << ' ' << how
        << (title.empty() ? " notitle" : " title " + gnuplot_literal(title));
    joint = ", ";
  };
  for (std::size_t k = 0; k < panel.series.size(); ++k) {
    const Series& s = panel.series[k];
    if (s.x.empty()) continue;
    const int color = s.color >= 0 ? s.color : next_color++;
    std::ostringstream style;
    style << "lc rgb '" << kPalette[static_cast<std::size_t>(color) % kPalette.size()] << "' ";
    std::ostringstream line;
    line << style.str() << "lw " << s.width;
    const std::string columns = "using 1:2 ";
    bool titled = false;
    if (!s.error.empty()) {
      element(k, "using 1:2:3 with yerrorbars " + style.str() + "pt 7 ps 0.45 lw 1", s.label);
      titled = true;
    }
    const std::string title = titled ? "" : s.label;
    switch (s.mark) {
      case Mark::kLine:
        element(k, columns + "with lines " + line.str(), title);
        break;
      case Mark::kDashes:
        element(k, columns + "with lines dt 2 " + line.str(), title);
        break;
      case Mark::kPoints:
        if (!titled) element(k, columns + "with points pt 7 ps 0.45 " + style.str(), title);
        break;
      case Mark::kLinePoints:
        element(k, columns + "with lines dt 2 lw 1 " + style.str(), "");
        if (!titled) element(k, columns + "with points pt 7 ps 0.45 " + style.str(), title);
        break;
      case Mark::kSteps:
        element(k, columns + "with steps " + line.str(), title);
        break;
      case Mark::kBand:
        element(k, "using 1:2:3 with filledcurves fs transparent solid 0.22 noborder " + style.str(), title);
        break;
      case Mark::kBars:
        element(k, columns + "with boxes fs solid 0.6 " + style.str(), title);
        break;
    }
  }
  if (std::string_view(joint) == "plot ") out << "plot NaN notitle";
  out << '\n';
}

void plot_panel(std::ostream& out, const Panel& panel, std::size_t p) {
  out << "reset\nset border 3 lc rgb '#555555'\nset tics nomirror out scale 0.5 textcolor rgb '#222222'\n"
         "set grid lc rgb '#e4e4e4' lt 1\nset samples 2\nset boxwidth 0.7 relative\n";
  if (!panel.title.empty()) out << "set title " << gnuplot_literal(panel.title) << " offset 0,-0.4\n";
  if (!panel.x_label.empty()) out << "set xlabel " << gnuplot_literal(panel.x_label) << " offset 0,0.3\n";
  if (!panel.y_label.empty()) out << "set ylabel " << gnuplot_literal(panel.y_label) << " offset 0.6,0\n";
  auto range = [&](const char* axis, const std::optional<std::pair<double, double>>& r) {
    if (!r) return;
    out << "set " << axis << "range [";
    number(out, r->first);
    out << ':';
    number(out, r->second);
    out << "]\n";
  };
  range("x", panel.x_range);
  range("y", panel.y_range);
  if (panel.x_tic > 0.0) {
    out << "set xtics ";
    number(out, panel.x_tic);
    out << '\n';
  }
  if (panel.log_x) {
    double low = 1e300, high = 0.0;
    for (const Series& s : panel.series)
      for (const double x : s.x)
        if (x > 0.0) {
          low = std::min(low, x);
          high = std::max(high, x);
        }
    // Many decades: short labels, or they run into each other.
    out << "set logscale x\nset format x '" << (high > 1e4 * low ? "1e%T" : "%g") << "'\n";
  }
  if (panel.log_y) out << "set logscale y\nset format y '%g'\n";
  out << (panel.key.empty() ? "unset key\n" : "set key " + panel.key + " samplen 1.5 spacing 1.0 nobox\n");
  for (const auto& [from, to] : panel.shaded) {
    out << "set object rectangle from first ";
    number(out, from);
    out << ", graph 0 to first ";
    number(out, to);
    out << ", graph 1 behind fc rgb '#f2e3c6' fs solid noborder\n";
  }
  for (const auto& [x, label] : panel.verticals) {
    out << "set arrow from first ";
    number(out, x);
    out << ", graph 0 to first ";
    number(out, x);
    out << ", graph 1 nohead lc rgb '#888888' dt 3\n";
    if (!label.empty()) {
      out << "set label " << gnuplot_literal(label) << " at first ";
      number(out, x);
      out << ", graph 0.97 offset 0.4,0 textcolor rgb '#555555'\n";
    }
  }
  if (!panel.categories.empty()) {
    out << "set xtics (";
    for (std::size_t i = 0; i < panel.categories.size(); ++i)
      out << (i > 0 ? ", " : "") << gnuplot_literal(panel.categories[i]) << ' ' << i;
    out << ") rotate by -35 left\n";
  }
  plot_elements(out, panel, p);
}

void plot_to(std::ostream& out, const Figure& figure, const char* terminal, const std::filesystem::path& file) {
  const int rows = (static_cast<int>(figure.panels.size()) + figure.columns - 1) / figure.columns;
  out << "reset\nset terminal " << terminal << " size " << figure.columns * figure.panel_width_px << ','
      << rows * figure.panel_height_px << "\nset output " << gnuplot_literal(file.string()) << '\n';
  const bool many = figure.panels.size() > 1;
  if (many) out << "set multiplot layout " << rows << ',' << figure.columns << '\n';
  for (std::size_t p = 0; p < figure.panels.size(); ++p) plot_panel(out, figure.panels[p], p);
  if (many) out << "unset multiplot\n";
  out << "unset output\n";
}

/// A file of our own, gone at the end of the scope.
struct TemporaryFile {
  std::filesystem::path path;
  TemporaryFile() {
    std::string pattern = (std::filesystem::temp_directory_path() / "isorig-figure-XXXXXX").string();
    const int descriptor = mkstemp(pattern.data());
    if (descriptor < 0) throw std::runtime_error("cannot make a temporary file for gnuplot");
    close(descriptor);
    path = pattern;
  }
  ~TemporaryFile() {
    std::error_code ignored;
    std::filesystem::remove(path, ignored);
  }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;
};

}  // namespace

Series thinned(Series series, std::size_t points) {
  const std::size_t n = series.x.size();
  if (n <= points || points < 4 || !series.error.empty() || series.mark == Mark::kBand) return series;
  Series out = series;
  out.x.clear();
  out.y.clear();
  const std::size_t stretches = points / 2;
  for (std::size_t k = 0; k < stretches; ++k) {
    const std::size_t a = k * n / stretches, b = (k + 1) * n / stretches;
    std::size_t low = a, high = a;
    for (std::size_t i = a; i < b; ++i) {
      if (series.y[i] < series.y[low]) low = i;
      if (series.y[i] > series.y[high]) high = i;
    }
    for (std::size_t i : {std::min(low, high), std::max(low, high)}) {
      out.x.push_back(series.x[i]);
      out.y.push_back(series.y[i]);
    }
  }
  return out;
}

std::string gnuplot_script(std::span<const Figure> figures, const std::filesystem::path& folder, bool png) {
  std::ostringstream out;
  out << "set encoding utf8\n";
  for (const Figure& figure : figures) {
    check(figure);
    write_data(out, figure);
    const std::string svg = "svg noenhanced font 'sans-serif,11' background '#ffffff'";
    plot_to(out, figure, svg.c_str(), folder / (figure.name + ".svg"));
    if (png)
      plot_to(out, figure, "pngcairo noenhanced font 'sans,9' background '#ffffff'", folder / (figure.name + ".png"));
  }
  return out.str();
}

void draw(std::span<const Figure> figures, const std::filesystem::path& folder, const DrawOptions& options) {
  if (figures.empty()) return;
  std::filesystem::create_directories(folder);
  const std::string script = gnuplot_script(figures, folder, options.png);
  const TemporaryFile file, messages;
  std::ofstream(file.path) << script;
  const pid_t child = fork();
  if (child < 0) throw std::runtime_error("cannot start gnuplot");
  if (child == 0) {
    if (std::freopen(messages.path.c_str(), "w", stderr) == nullptr) _exit(126);
    execlp(options.gnuplot.c_str(), options.gnuplot.c_str(), file.path.c_str(), static_cast<char*>(nullptr));
    _exit(127);
  }
  int status = 0;
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return;
  if (WIFEXITED(status) && WEXITSTATUS(status) == 127)
    throw std::runtime_error("cannot run '" + options.gnuplot + "': figures need the package gnuplot-nox");
  std::ifstream said(messages.path);
  throw std::runtime_error("gnuplot failed: " + std::string(std::istreambuf_iterator<char>(said), {}));
}

}  // namespace isorig::identify::report
