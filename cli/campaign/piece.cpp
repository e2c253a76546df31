#include "cli/campaign/piece.hpp"

#include <openssl/evp.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <memory>

#include "base/formatted.hpp"
#include "base/lock_file.hpp"
#include "base/text_file.hpp"
#include "base/toml_reader.hpp"
#include "base/utc_text.hpp"
#include "base/whole_file.hpp"
#include "cli/campaign/control.hpp"
#include "cli/campaign/row.hpp"
#include "identify/report/page.hpp"

namespace isorig::cli::pieces {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

constexpr const char* kPieceFormat = "isorig-piece/1";
constexpr std::uintmax_t kRoom_bytes = 64 << 20;  // a diagnosis with its page needs 1 to 5 MB
constexpr int kNothingFitted = 1;                 // what `isorig fv` returns then; its files say why
constexpr const char* kRunFile = "run.json";      // what a case took, also where it failed

std::int64_t ns_of(const timespec& time) {
  return std::int64_t{time.tv_sec} * 1'000'000'000 + time.tv_nsec;
}

ordered_json read_json(const fs::path& file) {
  return ordered_json::parse(base::read_text_file(file), nullptr, false);
}

/// On the disk before the rename that makes the piece appear: after a power cut it is whole or not there.
void write_synced(const fs::path& file, const std::string& text) {
  base::write_whole_file(file, text);
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> opened(std::fopen(file.c_str(), "r+"), std::fclose);
  if (!opened || ::fsync(::fileno(opened.get())) != 0)
    throw std::runtime_error(file.string() + ": " + std::strerror(errno));
}

ordered_json stamp_json(const Workshop& shop, const std::string& recording, const std::vector<FileStamp>& files) {
  ordered_json list = ordered_json::array();
  for (const FileStamp& one : files) list.push_back({{"name", one.name}, {"bytes", one.bytes}, {"sha256", one.sha256}});
  return {
      {"recording", recording}, {"files", std::move(list)}, {"ask", shop.ask_stamp}, {"program", shop.plan.program}};
}

/// A folder of one attempt, beside the place where its piece belongs; gone unless it was moved there.
class Attempted {
 public:
  explicit Attempted(const fs::path& final)
      : folder_(final.parent_path() / ("." + final.filename().string() + "." + base::host_name() + "." +
                                       std::to_string(::getpid()) + ".part")) {
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  ~Attempted() {
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
  }
  Attempted(const Attempted&) = delete;
  Attempted& operator=(const Attempted&) = delete;
  [[nodiscard]] const fs::path& folder() const { return folder_; }

  void become(const fs::path& place) const {
    fs::create_directories(place.parent_path());
    fs::remove_all(place);
    fs::rename(folder_, place);
  }

 private:
  fs::path folder_;
};

Attempt failed(const Workshop& shop, const std::string& recording, const Attempted* attempt, const std::string& why) {
  const fs::path place = failed_folder(shop.plan, recording);
  const ordered_json json{{"recording", recording},
                          {"failures", failures_of(shop.plan, recording) + 1},
                          {"why", why},
                          {"host", base::host_name()},
                          {"at_utc", base::utc_text(std::time(nullptr))}};
  try {
    if (attempt != nullptr) {
      // A log tells why; half of an answer would only be taken for one.
      for (const auto& entry : fs::directory_iterator(attempt->folder()))
        if (entry.path().filename() != "log.txt" && entry.path().filename() != kRunFile) fs::remove_all(entry.path());
      attempt->become(place);
    }
    fs::create_directories(place);
    base::write_whole_file(place / "failure.json",
                           json.dump(2, ' ', false, ordered_json::error_handler_t::replace) + "\n");
  } catch (const std::exception& e) {
    return {Ended::kFailed, why + "; that could not be noted: " + e.what()};
  }
  return {Ended::kFailed, why};
}

bool same_files(const std::vector<FileStamp>& a, const std::vector<FileStamp>& b) {
  return std::ranges::equal(a, b, [](const FileStamp& x, const FileStamp& y) {
    return x.name == y.name && x.bytes == y.bytes && x.written_ns == y.written_ns && x.changed_ns == y.changed_ns;
  });
}

FileState state_of(const fs::path& file) {
  struct stat found {};
  if (::stat(file.c_str(), &found) != 0) return {};
  return {found.st_dev, found.st_ino, static_cast<std::uintmax_t>(found.st_size), ns_of(found.st_mtim),
          ns_of(found.st_ctim)};
}

/// A hard link to it, or another owner, changes the inode alone.
bool replaced(const fs::path& program, FileState before) {
  const FileState now = state_of(program);
  before.changed_ns = now.changed_ns;
  return now != before;
}

/// Exit codes that are an answer. A case that cannot be read is an error of whoever made the study.
bool is_answer(const Ask& ask, int exit_code, const fs::path& made) {
  if (exit_code == 0) return true;
  if (ask.is_case()) return false;
  return exit_code == kBadRecording ||
         (exit_code == kNothingFitted && ask.command == "fv" && fs::exists(made / numbers_file(ask)));
}

/// How the files that decide the result stand, in the order of input_files().
std::vector<FileState> states_of(const std::vector<std::string>& files) {
  std::vector<FileState> out;
  for (const std::string& file : files) out.push_back(state_of(file));
  return out;
}

/// The words for this recording's model; they name its control where it has one.
std::vector<std::string> model_of(const Workshop& shop, const std::string& recording) {
  const Ask& ask = shop.plan.ask;
  if (ask.control.empty()) return model_words(ask, {}, "");
  std::string specimen;
  try {
    const auto document = base::TomlDocument::parse_file(fs::path(recording) / "recording.toml");
    specimen = document.root().string("specimen");
  } catch (const base::ConfigError&) {
    return {"--model", "slse1"};  // which says what is wrong with that file
  }
  return model_words(ask, shop.controls, specimen);
}

constexpr const char* kWouldMix =
    "; one table would mix pieces of both. Give the same command again (what was made with the old one is made anew), "
    "or put the old one back first";

Attempt attempt_piece(const Workshop& shop, const std::string& recording, const Attempted& attempt,
                      std::vector<FileStamp> files) {
  const fs::path& here = attempt.folder();
  for (FileStamp& one : files) one.sha256 = sha256_of_file(fs::path(recording) / one.name);
  const std::string began = base::utc_text(std::time(nullptr));
  const std::vector<std::string> inputs = input_files(shop.plan.ask);
  const std::vector<FileState> before = states_of(inputs);
  check_inputs(shop);
  const base::ProcessResult result =
      base::run_process(words_of(shop.plan.ask, shop.program, recording, model_of(shop, recording)), here / "log.txt",
                        {.working_directory = here, .among = shop.among});
  if (shop.among != nullptr && shop.among->ending()) return {Ended::kInterrupted, "interrupted"};
  // Before anything is made of its answer: which model it read nobody knows. One that was edited and put back has
  // another time.
  check_inputs(shop);
  for (std::size_t i = 0; i < inputs.size(); ++i)
    if (state_of(inputs[i]) != before[i])
      throw InputsChanged(inputs[i] + ": was written to while pieces were made of it; give the same command again");
  if (!is_answer(shop.plan.ask, result.exit_code, here))
    return failed(shop, recording, &attempt,
                  result.signal != 0
                      ? base::formatted("ended by signal %d (%s)", result.signal, ::strsignal(result.signal))
                      : base::formatted("exit code %d", result.exit_code));
  if (!same_files(files, files_of(shop.plan.ask, recording)))
    return failed(shop, recording, &attempt, "the recording was written to while it was read");
  const ordered_json piece{{"format", kPieceFormat},
                           {"stamp", stamp_json(shop, recording, files)},
                           {"exit_code", result.exit_code},
                           {"row", row_of_answer(shop.plan.ask, here, recording, result.exit_code)}};
  ordered_json times{{"began_utc", began},        {"wall_s", result.wall_s},   {"cpu_s", result.cpu_s},
                     {"peak_MB", result.peak_MB}, {"host", base::host_name()}, {"written_ns", ordered_json::object()}};
  for (const FileStamp& one : files) times["written_ns"][one.name] = one.written_ns;
  base::write_whole_file(here / "times.json", times.dump(2) + "\n");
  write_synced(here / "piece.json", piece.dump(2) + "\n");
  const fs::path final = piece_folder(shop.plan, recording);
  try {
    attempt.become(final);
  } catch (const fs::filesystem_error&) {
    // Another process may have been first, with the same.
    if (!is_done(shop, recording)) throw;
  }
  std::error_code ignored;
  fs::remove_all(failed_folder(shop.plan, recording), ignored);
  return {Ended::kMade, base::formatted("exit %d, %.1f s", result.exit_code, result.wall_s)};
}

}  // namespace

std::string sha256_of_file(const fs::path& file) {
  const std::unique_ptr<EVP_MD_CTX, void (*)(EVP_MD_CTX*)> context(EVP_MD_CTX_new(), EVP_MD_CTX_free);
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> in(
      base::why_not_a_file(file).empty() ? std::fopen(file.c_str(), "rbe") : nullptr, std::fclose);
  if (!in) throw base::FileError(file, std::string("cannot be read: ") + std::strerror(errno), errno == ENOENT);
  std::array<unsigned char, 1 << 16> part{};
  bool good = context && EVP_DigestInit_ex(context.get(), EVP_sha256(), nullptr) == 1;
  for (std::size_t size = part.size(); good && size == part.size();) {
    size = std::fread(part.data(), 1, part.size(), in.get());
    good = std::ferror(in.get()) == 0 && EVP_DigestUpdate(context.get(), part.data(), size) == 1;
  }
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned length = 0;
  if (!good || EVP_DigestFinal_ex(context.get(), digest.data(), &length) != 1)
    throw base::FileError(file, "cannot be read to its end", false);
  std::string text;
  for (unsigned i = 0; i < length; ++i) text += base::formatted("%02x", digest[i]);
  return text;
}

std::vector<FileStamp> files_of(const Ask& ask, const std::string& recording) {
  std::vector<FileStamp> out;
  for (const fs::path part : recordings_in(ask)) {
    bool described = false;
    for (const char* file : {"recording.toml", "frame.csv", "pressure.csv"}) {
      const fs::path name = part / file, path = recording / name;
      struct stat found {};
      if (::stat(path.c_str(), &found) == 0) {
        out.push_back(
            {name.string(), static_cast<std::uintmax_t>(found.st_size), ns_of(found.st_mtim), ns_of(found.st_ctim)});
        described = described || name.filename() == "recording.toml";
      } else if (errno != ENOENT && errno != ENOTDIR) {
        throw base::FileError(path, std::strerror(errno), false);
      }
    }
    if (!described)
      throw base::FileError(part.empty() ? fs::path(recording) : recording / part,
                            "no recording there (no recording.toml)", true);
  }
  return out;
}

fs::path piece_folder(const Plan& plan, const std::string& recording) {
  return plan.ask.is_case() ? plan.folder / fs::path(recording).filename()
                            : plan.folder / "pieces" / piece_name(recording);
}

fs::path failed_folder(const Plan& plan, const std::string& recording) {
  return plan.folder / "failed" / (plan.ask.is_case() ? fs::path(recording).filename() : piece_name(recording));
}

bool is_done(const Workshop& shop, const std::string& recording) {
  const fs::path folder = piece_folder(shop.plan, recording);
  if (!fs::exists(folder / "piece.json")) return false;
  try {
    const ordered_json piece = read_json(folder / "piece.json"), times = read_json(folder / "times.json");
    if (piece.at("format") != kPieceFormat) return false;
    const ordered_json& stamp = piece.at("stamp");
    std::vector<FileStamp> files = files_of(shop.plan.ask, recording);
    if (stamp.at("files").size() != files.size()) return false;
    for (std::size_t i = 0; i < files.size(); ++i) {
      const ordered_json& then = stamp.at("files").at(i);
      FileStamp& now = files[i];
      if (then.at("name") != now.name || then.at("bytes") != now.bytes) return false;
      now.sha256 = times.at("written_ns").value(now.name, std::int64_t{-1}) == now.written_ns
                       ? then.at("sha256").get<std::string>()
                       : sha256_of_file(fs::path(recording) / now.name);
    }
    return stamp == stamp_json(shop, recording, files);
  } catch (const base::FileError&) {
    return false;
  } catch (const nlohmann::json::exception&) {
    return false;
  }
}

bool made_as_planned(const Plan& plan, const std::string& recording) {
  const fs::path file = piece_folder(plan, recording) / "piece.json";
  if (!fs::exists(file)) return false;
  try {
    const ordered_json piece = read_json(file);
    const ordered_json& stamp = piece.at("stamp");
    return piece.at("format") == kPieceFormat &&
           stamp.at("ask") == stamp_of(plan.ask, plan.model_sha256, plan.control_sha256) &&
           stamp.at("program") == plan.program;
  } catch (const std::exception&) {
    return false;
  }
}

unsigned failures_of(const Plan& plan, const std::string& recording) {
  const fs::path file = failed_folder(plan, recording) / "failure.json";
  if (!fs::exists(file)) return 0;
  try {
    return read_json(file).at("failures").get<unsigned>();
  } catch (const std::exception&) {
    return 1;
  }
}

Workshop workshop_of(const Plan& plan, const fs::path& program) {
  Workshop shop{plan, stamp_of(plan.ask), program, nullptr, state_of(program), {}, {}};
  if (!plan.ask.judged.empty()) shop.judged_state = state_of(plan.ask.judged);
  const auto check = [&](const std::string& planned, const char* key, const std::string& file, const char* what) {
    if (!planned.empty() && shop.ask_stamp.value(key, std::string()) != planned)
      throw PlanError(file + ": is another " + what + " than when the campaign in " + plan.folder.string() + " began" +
                      kWouldMix);
  };
  check(plan.model_sha256, "model_sha256", plan.ask.model, "model");
  check(plan.control_sha256, "control_sha256", plan.ask.control, "analysis of controls");
  try {
    shop.controls = controls_of(plan.ask);
  } catch (const std::runtime_error& e) {
    throw PlanError(e.what());
  }
  return shop;
}

void check_inputs(const Workshop& shop) {
  const auto changed = [](const std::string& what) {
    throw InputsChanged(what + " after pieces were begun with it" + kWouldMix);
  };
  try {
    const ordered_json now = stamp_of(shop.plan.ask);
    if (now.value("control_sha256", std::string()) != shop.ask_stamp.value("control_sha256", std::string()))
      changed(shop.plan.ask.control + ": the analysis of the controls was changed");
    if (now != shop.ask_stamp) changed(shop.plan.ask.model + ": the model was changed");
  } catch (const base::FileError& e) {
    throw InputsChanged(std::string(e.what()) + "; put the " +
                        (shop.plan.ask.control.empty() ? "model" : "analysis of the controls") +
                        " back, then give the same command again");
  }
  if (shop.program_state && replaced(shop.program, *shop.program_state))
    changed(shop.program.string() + ": the program was replaced");
  if (shop.judged_state && replaced(shop.plan.ask.judged, *shop.judged_state))
    changed(shop.plan.ask.judged + ": the program was replaced");
}

Attempt make_piece(const Workshop& shop, const std::string& recording) {
  check_inputs(shop);
  std::error_code unknown;
  const auto space = fs::space(shop.plan.folder, unknown);
  if (!unknown && space.available < kRoom_bytes)
    throw NoRoom(shop.plan.folder.string() +
                 ": less than 64 MB of room left; make room, then give the same command again");
  std::unique_ptr<Attempted> attempt;
  try {
    if (is_done(shop, recording)) return {Ended::kDoneBefore, "done before"};
    const fs::path final = piece_folder(shop.plan, recording);
    fs::remove_all(final);  // of what the recording was: not to be taken for what it is, also where it is gone
    std::vector<FileStamp> files = files_of(shop.plan.ask, recording);
    attempt = std::make_unique<Attempted>(final);
    return attempt_piece(shop, recording, *attempt, std::move(files));
  } catch (const CannotGoOn&) {
    throw;
  } catch (const std::exception& e) {
    return failed(shop, recording, attempt.get(), e.what());
  }
}

void sweep(const Plan& plan) {
  const auto sweep_folder = [](const fs::path& folder) {
    std::vector<fs::path> left;
    std::error_code error;
    for (fs::directory_iterator at(folder, error), last; !error && at != last; at.increment(error)) {
      const fs::path name = at->path().filename();
      if (name.string().starts_with(".") && name.extension() == ".part") left.push_back(at->path());
    }
    for (const fs::path& one : left) fs::remove_all(one, error);
  };
  if (plan.ask.is_case()) return sweep_folder(plan.folder);
  std::error_code none;
  for (fs::directory_iterator shard(plan.folder / "pieces", none), end; !none && shard != end; shard.increment(none))
    sweep_folder(shard->path());
}

}  // namespace isorig::cli::pieces
