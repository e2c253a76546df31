// A target without libFuzzer: replays every file of the folders that are named, then changes them at random. Which
// change comes when follows from --seed alone. For compilers without -fsanitize=fuzzer: nothing here looks at coverage.
//
//   TARGET --runs=N --seed=S [--rss-limit-MiB=M] [--timeout-s=T] FOLDER...
//
// The input at work lies in INPUT (printed when the program dies), so that what ended it is there afterwards.
#include <fcntl.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <random>
#include <vector>

#include "target.hpp"

namespace {

using Buffer = std::vector<std::uint8_t>;
constexpr std::size_t kLongest = std::size_t{128} << 10U;

struct Options {
  std::uint64_t runs = 0, seed = 1, rss_limit_MiB = 2048, timeout_s = 20;
  std::vector<std::filesystem::path> folders;
};

[[noreturn]] void usage(const char* program) {
  std::fprintf(stderr, "usage: %s [--runs=N] [--seed=S] [--rss-limit-MiB=M] [--timeout-s=T] FOLDER...\n", program);
  std::exit(2);
}

Options options_of(int argc, char** argv) {
  Options options;
  for (int i = 1; i < argc; ++i) {
    const std::string_view word = argv[i];
    if (!word.starts_with("--")) {
      options.folders.emplace_back(word);
      continue;
    }
    const auto equals = word.find('=');
    const auto key = word.substr(0, equals);
    auto* to = key == "--runs"            ? &options.runs
               : key == "--seed"          ? &options.seed
               : key == "--rss-limit-MiB" ? &options.rss_limit_MiB
               : key == "--timeout-s"     ? &options.timeout_s
                                          : nullptr;
    if (to == nullptr || equals == std::string_view::npos) usage(argv[0]);
    const char* end = word.data() + word.size();
    const auto [stop, error] = std::from_chars(word.data() + equals + 1, end, *to);
    if (error != std::errc{} || stop != end) usage(argv[0]);
  }
  if (options.folders.empty()) usage(argv[0]);
  return options;
}

/// The input at work, in a file that outlives the program: mapped, so that writing it costs a copy.
class AtWork {
 public:
  AtWork() {
    name_ = (std::filesystem::temp_directory_path() / "isorig-fuzz-input-XXXXXX").string();
    fd_ = ::mkstemp(name_.data());
    isorig::fuzz::require(fd_ >= 0 && ::ftruncate(fd_, kLongest) == 0, "no file for the input at work");
    map_ = ::mmap(nullptr, kLongest, PROT_READ | PROT_WRITE, MAP_SHARED, fd_, 0);
    isorig::fuzz::require(map_ != MAP_FAILED, "no file for the input at work");
  }
  void keep(const Buffer& input) {
    size_ = input.size();
    std::memcpy(map_, input.data(), input.size());
  }
  void remove() { ::unlink(name_.c_str()); }
  /// In a handler of signals.
  void tell() {
    (void)!::ftruncate(fd_, static_cast<off_t>(size_));
    for (const std::string_view part :
         {std::string_view("fuzz: the input is in "), std::string_view(name_), std::string_view("\n")})
      (void)!::write(STDERR_FILENO, part.data(), part.size());
  }

 private:
  std::string name_;
  int fd_ = -1;
  void* map_ = nullptr;
  std::size_t size_ = 0;
};

AtWork* at_work = nullptr;

extern "C" void died(int signal_number) {
  if (signal_number == SIGALRM) {
    constexpr std::string_view kText = "fuzz: an input took longer than it may\n";
    (void)!::write(STDERR_FILENO, kText.data(), kText.size());
  }
  at_work->tell();
  ::signal(SIGABRT, SIG_DFL);
  ::abort();
}

/// What a careless hand, a bad disk and a bad line do.
class Changes {
 public:
  explicit Changes(std::uint64_t seed) : random_(seed) {}
  [[nodiscard]] std::size_t below(std::size_t bound) {
    return static_cast<std::size_t>(random_() % std::max<std::uint64_t>(bound, 1));
  }

  Buffer changed(Buffer input, const Buffer& other) {
    for (auto left = 1 + below(5); left > 0; --left) change(input, other);
    if (input.size() > kLongest) input.resize(kLongest);
    return input;
  }

 private:
  void change(Buffer& input, const Buffer& other) {
    const auto at = below(input.size() + 1);
    const auto here = input.begin() + static_cast<std::ptrdiff_t>(at);
    const auto length = std::min(below(std::size_t{1} << (1 + below(10))), input.size() - at);
    switch (below(8)) {
      case 0:
        if (at < input.size()) input[at] ^= static_cast<std::uint8_t>(1U << below(8));
        return;
      case 1:
        if (at < input.size()) input[at] = static_cast<std::uint8_t>(random_());
        return;
      case 2:
        input.erase(here, here + static_cast<std::ptrdiff_t>(length));
        return;
      case 3: {
        const Buffer twice(here, here + static_cast<std::ptrdiff_t>(length));
        input.insert(here, twice.begin(), twice.end());
        return;
      }
      case 4: {
        static constexpr std::string_view kOdd[] = {"0",
                                                    "-1",
                                                    "1e308",
                                                    "nan",
                                                    "inf",
                                                    "-0.0",
                                                    "9223372036854775807",
                                                    "4294967295",
                                                    "\"",
                                                    "[",
                                                    "]",
                                                    "{",
                                                    "}",
                                                    "=",
                                                    "\n",
                                                    "\r\n",
                                                    ",",
                                                    ";",
                                                    "\t",
                                                    "%%%%",
                                                    "\xff\xfe",
                                                    std::string_view("\0\0\0\0", 4),
                                                    "\x7f\xff\xff\xff",
                                                    "\xff\xff\xff\xff",
                                                    "\x80",
                                                    "1.7976931348623157e308",
                                                    "2.2250738585072014e-308"};
        const auto odd = kOdd[below(std::size(kOdd))];
        input.insert(here, odd.begin(), odd.end());
        return;
      }
      case 5: {
        const auto from = below(other.size() + 1);
        const auto size = std::min(below(512), other.size() - from);
        const auto begin = other.begin() + static_cast<std::ptrdiff_t>(from);
        input.insert(here, begin, begin + static_cast<std::ptrdiff_t>(size));
        return;
      }
      case 6:
        input.resize(at);
        return;
      default:
        for (std::size_t i = 0; i < length; ++i) input[at + i] = static_cast<std::uint8_t>(random_());
    }
  }

  std::mt19937_64 random_;
};

long rss_MiB() {
  rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  return usage.ru_maxrss / 1024;
}

}  // namespace

int main(int argc, char** argv) {
  const auto options = options_of(argc, argv);
  std::vector<std::filesystem::path> files;
  for (const auto& folder : options.folders)
    for (const auto& entry : std::filesystem::recursive_directory_iterator(folder))
      if (entry.is_regular_file()) files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  std::vector<Buffer> seeds;
  for (const auto& file : files) {
    std::ifstream in(file, std::ios::binary);
    seeds.emplace_back(std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>());
    if (seeds.back().size() > kLongest) seeds.back().resize(kLongest);
  }
  isorig::fuzz::require(!seeds.empty(), "there is no seed in the folders named");

  AtWork kept;
  at_work = &kept;
  ::signal(SIGABRT, died);
  ::signal(SIGALRM, died);
  const auto run = [&](const Buffer& input) {
    kept.keep(input);
    ::alarm(static_cast<unsigned>(options.timeout_s));
    // A copy of its own size: a byte read beyond it is seen by the sanitizer.
    const Buffer exact(input.begin(), input.end());
    LLVMFuzzerTestOneInput(exact.data(), exact.size());
    ::alarm(0);
    isorig::fuzz::require(rss_MiB() <= static_cast<long>(options.rss_limit_MiB), "more memory than an input may take");
  };
  const auto began = std::chrono::steady_clock::now();
  for (const auto& seed : seeds) run(seed);
  Changes changes(options.seed);
  for (std::uint64_t i = 0; i < options.runs; ++i) {
    const auto& from = seeds[changes.below(seeds.size())];
    const auto& other = seeds[changes.below(seeds.size())];
    run(changes.changed(from, other));
  }
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - began;
  std::printf("%zu seeds and %llu changed inputs in %.1f s, at most %ld MiB\n", seeds.size(),
              static_cast<unsigned long long>(options.runs), took.count(), rss_MiB());
  kept.remove();
  return 0;
}
