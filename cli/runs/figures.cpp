#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <thread>

#include "base/printable.hpp"
#include "base/text_file.hpp"
#include "base/toml_reader.hpp"
#include "cli/command.hpp"
#include "cli/screen/progress.hpp"

/// isorig figures: the figures of a page as files. A page draws itself, in a browser; so does this, in one without a
/// window, and what it gets is what the page's own buttons save (web/src/report/save.ts).
namespace isorig::cli {
namespace {

namespace fs = std::filesystem;
constexpr auto kBrowserPatience = std::chrono::seconds(90);
constexpr int kScale = 3;  ///< of a PNG: 288 dots an inch, as the page's button has it

struct FiguresOptions {
  std::string page, out, browser;
  int width = 1100;
  bool png = false;
};

volatile std::sig_atomic_t figures_interrupted = 0;

/// Whoever ends it, with Ctrl-C, a time limit or by closing the terminal: the browser and its folder go with it.
class Signals {
 public:
  Signals() {
    figures_interrupted = 0;
    for (std::size_t i = 0; i < kEnding.size(); ++i) {
      former_[i] = std::signal(kEnding[i], [](int) { figures_interrupted = 1; });
      if (former_[i] == SIG_IGN) std::signal(kEnding[i], SIG_IGN);  // nohup, a job in the background
    }
  }
  ~Signals() {
    for (std::size_t i = 0; i < kEnding.size(); ++i) std::signal(kEnding[i], former_[i]);
  }
  Signals(const Signals&) = delete;
  Signals& operator=(const Signals&) = delete;

 private:
  static constexpr std::array kEnding{SIGINT, SIGTERM, SIGHUP, SIGQUIT};
  std::array<void (*)(int), kEnding.size()> former_{};
};

/// A folder that is gone with this: the browser's profile, and what it says.
class Scratch {
 public:
  Scratch() {
    std::string name = (fs::temp_directory_path() / "isorig-figures-XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) throw std::runtime_error("cannot make a folder like " + name);
    path = name;
  }
  ~Scratch() {
    // A killed browser's processes die one by one, and may still put a file there.
    std::error_code error;
    for (int i = 0; i < 40; ++i) {
      fs::remove_all(path, error);
      if (!error && !fs::exists(path, error)) return;
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
    std::cerr << "isorig figures: " << path.string() << " could not be removed: " << error.message() << '\n';
  }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
  fs::path path;
};

std::string find_browser(const std::string& named) {
  if (!named.empty()) return named;
  const char* path = std::getenv("PATH");
  std::istringstream folders(path == nullptr ? "" : path);
  std::vector<fs::path> all;
  for (std::string folder; std::getline(folders, folder, ':');) all.emplace_back(folder);
  for (const char* name : {"chromium", "chromium-browser", "google-chrome", "google-chrome-stable"}) {
    for (const auto& folder : all) {
      if (::access((folder / name).c_str(), X_OK) == 0) return (folder / name).string();
    }
  }
  throw std::runtime_error(
      "pages draw themselves in a browser, and there is no Chromium on the PATH: apt install chromium, or name one "
      "with "
      "--browser");
}

/// A browser and the processes that it starts: a process group of their own, which is killed with this unless the
/// browser has ended.
class Group {
 public:
  explicit Group(pid_t pid) : pid_(pid) {}
  ~Group() {
    if (pid_ <= 0) return;
    ::kill(-pid_, SIGKILL);
    while (::waitpid(pid_, nullptr, 0) < 0 && errno == EINTR) {
    }
  }
  Group(const Group&) = delete;
  Group& operator=(const Group&) = delete;
  /// waitpid's status once it has ended.
  std::optional<int> ended() {
    int status = 0;
    const auto pid = ::waitpid(pid_, &status, WNOHANG);
    if (pid == 0 || (pid < 0 && errno == EINTR)) return std::nullopt;
    pid_ = -1;
    if (pid < 0) throw std::runtime_error(std::string("the browser was lost: ") + std::strerror(errno));
    return status;
  }

 private:
  pid_t pid_;
};

/// Its standard output. Throws when it fails or takes too long, or when a signal ends this.
std::string run_browser(const std::string& browser, const Scratch& scratch, std::vector<std::string> more) {
  std::vector<std::string> words{browser,
                                 "--headless",
                                 "--disable-gpu",
                                 "--no-first-run",
                                 "--disable-background-networking",
                                 "--disable-component-update",
                                 "--disable-sync",
                                 "--disable-quic",
                                 "--hide-scrollbars",
                                 "--user-data-dir=" + (scratch.path / "profile").string()};
  if (::geteuid() == 0) words.emplace_back("--no-sandbox");  // its sandbox refuses root; the page is a file of our own
  words.insert(words.end(), more.begin(), more.end());
  std::vector<char*> arguments;
  for (auto& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  const auto said = scratch.path / "said";
  posix_spawn_file_actions_t files;
  ::posix_spawn_file_actions_init(&files);
  ::posix_spawn_file_actions_addopen(&files, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  ::posix_spawn_file_actions_addopen(&files, STDOUT_FILENO, said.c_str(), O_CREAT | O_TRUNC | O_WRONLY, 0600);
  ::posix_spawn_file_actions_addopen(&files, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
  posix_spawnattr_t attributes;
  ::posix_spawnattr_init(&attributes);
  ::posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);
  ::posix_spawnattr_setpgroup(&attributes, 0);
  pid_t pid = 0;
  const int error = ::posix_spawn(&pid, browser.c_str(), &files, &attributes, arguments.data(), environ);
  ::posix_spawnattr_destroy(&attributes);
  ::posix_spawn_file_actions_destroy(&files);
  if (error != 0) throw std::runtime_error(browser + " cannot be started: " + std::strerror(error));
  Group group(pid);
  const auto until = std::chrono::steady_clock::now() + kBrowserPatience;
  std::optional<int> status;
  while (!(status = group.ended())) {
    if (figures_interrupted != 0) throw std::runtime_error("ended by a signal while the browser drew");
    if (std::chrono::steady_clock::now() > until) {
      throw std::runtime_error(browser + " did not draw the page within 90 s");
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  if (!WIFEXITED(*status) || WEXITSTATUS(*status) != 0) throw std::runtime_error(browser + " failed");
  return base::read_text_file(said);
}

/// RFC 8089 and RFC 3986, 2.3: all but the unreserved characters and the slash is percent-encoded, byte by byte.
std::string file_url(const fs::path& path) {
  constexpr std::string_view kKept = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_.~/",
                             kHex = "0123456789ABCDEF";
  std::string url = "file://";
  for (const char c : path.string()) {
    const auto byte = static_cast<unsigned char>(c);
    url += kKept.find(c) != kKept.npos ? std::string{c} : std::string{'%', kHex[byte >> 4U], kHex[byte & 15U]};
  }
  return url;
}

/// What the browser writes into text: three characters have names.
std::string unescaped(std::string text) {
  for (const auto& [name, c] : {std::pair{"&lt;", "<"}, {"&gt;", ">"}, {"&amp;", "&"}}) {
    std::string out;
    std::size_t from = 0;
    for (std::size_t at = 0; (at = text.find(name, from)) != text.npos; from = at + std::strlen(name)) {
      out += text.substr(from, at - from) + c;
    }
    text = out + text.substr(from);
  }
  return text;
}

nlohmann::json figures_of(const fs::path& page, int width, const std::string& browser, const Scratch& scratch) {
  const auto dom = run_browser(browser, scratch,
                               {"--window-size=" + std::to_string(width) + ",1400", "--virtual-time-budget=20000",
                                "--dump-dom", file_url(fs::canonical(page)) + "#figures"});
  constexpr std::string_view kBegin = "<pre id=\"figures\">", kEnd = "</pre>";
  const auto begin = dom.find(kBegin), end = dom.find(kEnd, begin == dom.npos ? 0 : begin);
  if (begin == dom.npos || end == dom.npos) {
    throw std::runtime_error(page.string() + " is no page of isorig's, or an older one: make it again (isorig report)");
  }
  return nlohmann::json::parse(unescaped(dom.substr(begin + kBegin.size(), end - begin - kBegin.size())));
}

int figures(const FiguresOptions& options) {
  if (!fs::is_regular_file(options.page)) {
    throw base::ConfigError({{options.page, 0, 0, "no such file; a page is a report.html, or another report's"}});
  }
  const Signals signals;
  const Scratch scratch;
  const auto browser = find_browser(options.browser);
  Progress progress("figures");
  const auto all = figures_of(options.page, options.width, browser, scratch);
  fs::create_directories(options.out);
  std::vector<std::string> written;
  for (const auto& figure : all) {
    const auto name = figure.at("name").get<std::string>();
    if (!base::why_not_a_name(name).empty()) throw std::runtime_error("a figure is called " + base::printable(name));
    progress.at(static_cast<double>(written.size()) / static_cast<double>(all.size()), name);
    const auto svg = options.png ? scratch.path / (name + ".svg") : fs::path(options.out) / (name + ".svg");
    std::ofstream(svg, std::ios::binary) << figure.at("svg").get<std::string>() << '\n';
    auto file = svg;
    if (options.png) {
      file = fs::path(options.out) / (name + ".png");
      (void)run_browser(browser, scratch,
                        {"--force-device-scale-factor=" + std::to_string(kScale),
                         "--window-size=" + std::to_string(figure.at("width").get<int>()) + "," +
                             std::to_string(figure.at("height").get<int>()),
                         "--screenshot=" + fs::absolute(file).string(), file_url(fs::absolute(svg))});
    }
    if (!fs::exists(file) || fs::file_size(file) == 0)
      throw std::runtime_error(file.string() + " could not be written");
    written.push_back(file.string());
  }
  for (const auto& file : written) std::printf("%s\n", base::printable(file).c_str());
  if (written.empty()) std::cerr << "isorig figures: " << options.page << " has no figure\n";
  return written.empty() ? kFailure : kOk;
}

Command add_figures(CLI::App& app) {
  auto o = std::make_shared<FiguresOptions>();
  auto* sub = app.add_subcommand("figures", "The figures of a report's page as files, SVG or PNG; needs Chromium");
  sub->add_option("PAGE", o->page, "report.html, fv-report.html, diagnosis-report.html, ...")->required();
  sub->add_option("--out", o->out, "Folder for them; made if needed")->required();
  sub->add_flag("--png", o->png, "PNG at 288 dots an inch instead of SVG");
  sub->add_option("--width", o->width, "Of the page on the screen, in pixels")
      ->capture_default_str()
      ->check(CLI::Range(400, 4000));
  sub->add_option("--browser", o->browser, "Chromium's program, if it is not on the PATH");
  return {sub, [o] { return figures(*o); }};
}

const Registration kFigures(44, add_figures);

}  // namespace
}  // namespace isorig::cli
