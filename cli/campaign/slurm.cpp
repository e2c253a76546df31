#include "cli/campaign/slurm.hpp"

#include <unistd.h>
#include <wordexp.h>

#include <algorithm>
#include <charconv>
#include <fstream>
#include <map>
#include <sstream>

#include "base/fingerprint.hpp"
#include "base/formatted.hpp"
#include "base/printable.hpp"
#include "base/process.hpp"
#include "base/text_file.hpp"
#include "base/whole_file.hpp"
#include "identify/report/page.hpp"

namespace isorig::cli::pieces {
namespace {

namespace fs = std::filesystem;

/// As a shell has it between single quotes.
std::string quoted(const std::string& word) {
  std::string out = "'";
  for (const char c : word) out += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return out + "'";
}

std::vector<std::string> split(const std::string& text) {
  wordexp_t words{};
  if (::wordexp(text.c_str(), &words, WRDE_NOCMD | WRDE_UNDEF) != 0)
    throw SlurmError("--slurm-options: cannot be split into words as a shell does it; quote what has spaces");
  std::vector<std::string> out(words.we_wordv, words.we_wordv + words.we_wordc);
  ::wordfree(&words);
  return out;
}

std::string trimmed(std::string text) {
  while (!text.empty() && std::isspace(static_cast<unsigned char>(text.back())) != 0) text.pop_back();
  return base::printable_lines(text);
}

}  // namespace

struct Slurm::Said {
  int code = 0;
  std::string text;
};

Slurm::Slurm(const Plan& plan, fs::path program, SlurmOptions options)
    : plan_(plan), program_(std::move(program)), folder_(plan.folder / "slurm"), options_(std::move(options)) {
  fs::create_directories(folder_);
}

Slurm::Said Slurm::ask(const std::vector<std::string>& words) const {
  const fs::path answer = folder_ / ("answer-" + std::to_string(::getpid()) + ".txt");
  fs::remove(answer);
  Said said;
  try {
    said.code = base::run_process(words, answer).exit_code;
  } catch (const std::runtime_error& e) {
    throw SlurmError(words.front() +
                     ": not found; --on slurm needs Slurm's own commands (Debian: slurm-client) on PATH");
  }
  said.text = trimmed(base::read_text_file(answer));
  fs::remove(answer);
  return said;
}

std::string Slurm::job_name(std::size_t number) const {
  return "isorig-" + base::fingerprint(plan_.folder.string()) + "-" + std::to_string(number);
}

std::optional<Array> Slurm::under_way() const {
  const Said said = ask({"squeue", "--noheader", "--me", "--format=%F %j"});
  if (said.code != 0)
    throw SlurmError("squeue: " + said.text + "; is slurmctld up, and does SLURM_CONF name its file?");
  const std::string ours = job_name(0).substr(0, job_name(0).size() - 1);
  std::optional<Array> newest;
  std::istringstream lines(said.text);
  for (std::string job, name; lines >> job && std::getline(lines >> std::ws, name);) {
    if (!name.starts_with(ours)) continue;
    std::size_t number = 0;
    std::from_chars(name.data() + ours.size(), name.data() + name.size(), number);
    if (number > 0 && (!newest || number > newest->number)) newest = Array{number, job};
  }
  return newest;
}

std::size_t Slurm::next_number() const {
  std::size_t number = 1;
  while (fs::exists(list_of(number))) ++number;
  return number;
}

fs::path Slurm::list_of(std::size_t number) const {
  return folder_ / ("array-" + std::to_string(number) + ".txt");
}

std::size_t Slurm::most_tasks() const {
  const Said said = ask({"scontrol", "show", "config"});
  if (said.code != 0)
    throw SlurmError("scontrol: " + said.text + "; is slurmctld up, and does SLURM_CONF name its file?");
  const auto at = said.text.find("MaxArraySize");
  const auto equals = said.text.find('=', at);
  std::size_t most = 0;
  if (at != std::string::npos && equals != std::string::npos)
    most = std::strtoul(said.text.c_str() + equals + 1, nullptr, 10);
  if (most < 2)
    throw SlurmError("scontrol show config: no MaxArraySize above 1, without which there are no job arrays");
  return most - 1;  // indices begin at 0 and stay below it
}

Array Slurm::submit(std::size_t number, std::size_t lines) const {
  const std::size_t per_task = std::max<std::size_t>(1, options_.per_task);
  const std::size_t tasks = std::min((lines + per_task - 1) / per_task, most_tasks());
  const fs::path list = list_of(number);
  const fs::path script = fs::path(list).replace_extension(".sh"), logs = fs::path(list).replace_extension();
  fs::create_directories(logs);
  base::write_whole_file(script, "#!/bin/sh\nexec " + quoted(program_.string()) + " campaign-pieces " +
                                     quoted(plan_.folder.string()) + " --list " + quoted(list.string()) +
                                     " --task \"$SLURM_ARRAY_TASK_ID\" --of " + std::to_string(tasks) + "\n");
  std::vector<std::string> words{"sbatch", "--parsable", "--requeue", "--open-mode=append",
                                 "--cpus-per-task=" + std::to_string(plan_.ask.threads)};
  for (const std::string& word : split(options_.more)) words.push_back(word);
  // Behind the user's: by these an array is found again. The log's name is relative: % means something else in it.
  words.insert(words.end(), {"--job-name=" + job_name(number), "--array=0-" + std::to_string(tasks - 1),
                             "--chdir=" + logs.string(), "--output=task-%a.txt", script.string()});
  const Said said = ask(words);
  if (said.code != 0) throw SlurmError("sbatch refused: " + said.text);
  // "12" or "12;cluster", behind what sbatch may have warned of.
  const std::string last = said.text.substr(said.text.find_last_of('\n') + 1);
  const std::string job = last.substr(0, last.find(';'));
  if (job.empty() || !std::ranges::all_of(job, [](unsigned char c) { return std::isdigit(c) != 0; }))
    throw SlurmError("sbatch: no number of a job in its answer: " + said.text);
  return {number, job};
}

ArrayState Slurm::state_of(const Array& array) const {
  const Said said = ask({"squeue", "--noheader", "--array", "--job=" + array.job, "--format=%T %r"});
  if (said.code != 0) {
    // slurmctld forgets a job some minutes after its end (MinJobAge).
    if (said.text.find("Invalid job id") != std::string::npos) return {ArrayState::kGone, ""};
    return {ArrayState::kNoAnswer, "squeue: " + said.text};
  }
  std::map<std::string, std::size_t> count;
  std::istringstream lines(said.text);
  for (std::string line; std::getline(lines, line);) {
    const auto space = line.find(' ');
    std::string state = line.substr(0, space), reason = space == std::string::npos ? "" : line.substr(space + 1);
    std::ranges::transform(state, state.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    if (state == "pending" && reason != "None") state += " (" + reason + ")";
    ++count[state];
  }
  if (count.empty()) return {ArrayState::kGone, ""};
  std::string words;
  for (const auto& [state, tasks] : count) words += (words.empty() ? "" : ", ") + std::to_string(tasks) + " " + state;
  return {ArrayState::kThere, words};
}

Done Slurm::tally_of(const Array& array) const {
  Done all;
  std::error_code none;
  const fs::path folder = fs::path(list_of(array.number)).replace_extension();
  for (fs::directory_iterator at(folder, none), end; !none && at != end; at.increment(none)) {
    if (at->path().extension() != ".tally") continue;
    std::ifstream in(at->path());
    std::size_t ended = 0, failed = 0;
    if (in >> ended >> failed) {
      all.ended += ended;
      all.failed += failed;
    }
  }
  return all;
}

void write_tally(const fs::path& list, const Share& share, const Done& done) {
  const fs::path folder = fs::path(list).replace_extension();
  if (!fs::is_directory(folder)) return;
  base::write_whole_file(folder / ("task-" + std::to_string(share.task) + ".tally"),
                         std::to_string(done.ended) + " " + std::to_string(done.failed) + "\n");
}

}  // namespace isorig::cli::pieces
