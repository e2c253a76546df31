#include "cli/campaign/runner.hpp"

#include <algorithm>
#include <chrono>
#include <fstream>
#include <iostream>
#include <ostream>
#include <utility>

#include "base/formatted.hpp"
#include "cli/campaign/local.hpp"
#include "cli/campaign/piece.hpp"
#include "cli/campaign/signals.hpp"
#include "cli/screen/progress.hpp"

namespace isorig::cli::pieces {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point then) {
  return std::chrono::duration<double>(Clock::now() - then).count();
}

/// Merging reads every piece: not more often than each half minute, nor for more than a twentieth of the time. A signal
/// ends it at once, and is left to whoever waits for signals.
class Merges {
 public:
  Merges(const Plan& plan, const Signals& signals) : plan_(plan), signals_(signals) {}
  /// `words`: what else is going on.
  void maybe(Progress& progress, const std::string& words) {
    if (seconds_since(ended_) < std::max(30.0, 20.0 * took_s_)) return;
    const auto began = Clock::now();
    (void)merge(plan_, nullptr,
                {[this] { return signals_.came(); },
                 [&](double fraction, const std::string& doing) {
                   progress.says(words + ", " + doing + base::formatted(" (%.0f %%)", 100.0 * fraction));
                 }});
    ended_ = Clock::now();
    took_s_ = std::chrono::duration<double>(ended_ - began).count();
  }

 private:
  const Plan& plan_;
  const Signals& signals_;
  Clock::time_point ended_ = Clock::now();
  double took_s_ = 0.0;
};

/// Of the line that shows how far it is.
std::string title_of(const Ask& ask) {
  return ask.is_case() ? "cases" : "campaign";
}

class Runner {
 public:
  Runner(const CampaignCall& call, const Signals& signals)
      : call_(call),
        signals_(signals),
        title_(title_of(call.plan.ask)),
        merges_(call.plan, signals),
        // As write_plan() read it: the tasks of an array compare with that.
        shop_(workshop_of(read_plan(call.plan.folder), call.program)) {
    if (call.slurm) slurm_.emplace(call.plan, call.program, *call.slurm);
  }

  /// "" when all that can be made is made; else why not.
  std::string run(std::size_t recordings) {
    fs::path from = recordings_of(call_.plan);
    bool fresh = true;
    if (slurm_) {
      if (const auto array = slurm_->under_way()) {
        std::cerr << caller_of(call_.plan.ask) << ": job array " << array->job
                  << " of an earlier call is under way; waiting for it\n";
        if (const std::string why = wait_for(*array, 0); stopped_by != 0 || !why.empty()) return why;
        fresh = false;
      }
    }
    // Tasks outlive the call that submitted them, and Slurm need not be on this machine: they have a lock of their own.
    std::optional<FolderLock> alone;
    try {
      alone.emplace(call_.plan.folder, FolderLock::Of::kMaker);
      sweep(call_.plan);
    } catch (const PlanError&) {
      if (!slurm_) throw;
      // Slurm knows of no task here: a node that died may keep its lock for as long as its file server likes.
    }
    if (slurm_) alone.reset();
    unsigned fruitless = 0;
    std::size_t before = 0;  // what was to be done in the round before
    for (std::size_t known = recordings;; known = before) {
      const std::size_t number = slurm_ ? slurm_->next_number() : 0;
      const fs::path list = slurm_ ? slurm_->list_of(number) : call_.plan.folder / "todo.txt";
      const std::size_t left = scan(from, list, fresh, known);
      if (stopped_by != 0) return "";
      if (const std::string why = changed(); !why.empty() || left == 0) {
        fs::remove(list);
        return why;
      }
      if (before != 0) fruitless = progress_made(before, left) ? 0 : fruitless + 1;
      if (fruitless > call_.retries) return gave_up();
      if (slurm_) {
        const Array array = slurm_->submit(number, left);
        std::cerr << caller_of(call_.plan.ask) << ": submitted as job array " << array.job << ", " << left << ' '
                  << subjects_of(call_.plan.ask) << '\n';
        if (const std::string why = wait_for(array, left); stopped_by != 0 || !why.empty()) return why;
      } else if (const std::string why = here(list, left); stopped_by != 0 || !why.empty()) {
        return why;
      }
      // Later rounds look at what was left alone.
      if (slurm_) {
        from = list;
      } else {
        from = call_.plan.folder / "todo-before.txt";
        fs::rename(list, from);
      }
      fresh = false;
      before = left;
    }
  }

  int stopped_by = 0;

 private:
  /// Why pieces that are made now are of another model or program than those before; "" where they are not.
  [[nodiscard]] std::string changed() const {
    try {
      check_inputs(shop_);
      return "";
    } catch (const InputsChanged& e) {
      return e.what();
    }
  }

  /// Writes the recordings that are to be made into `to`; of those that failed, only while they may be repeated.
  /// `fresh`: failures of an earlier call do not count.
  std::size_t scan(const fs::path& from, const fs::path& to, bool fresh, std::size_t lines) {
    Progress progress(title_);
    std::ofstream out(to.string() + ".part", std::ios::binary);
    std::size_t left = 0, seen = 0, failures = 0;
    for_each_line(from, [&](const std::string& recording) {
      if (stopped_by != 0) return;
      if (++seen % 256 == 0) {
        stopped_by = signals_.wait(0.0);
        progress.at(static_cast<double>(seen) / static_cast<double>(lines), "looking what is done");
      }
      if (is_done(shop_, recording)) return;
      unsigned failed = failures_of(call_.plan, recording);
      if (fresh && failed > 0) {
        fs::remove_all(failed_folder(call_.plan, recording));
        failed = 0;
      }
      if (failed > call_.retries) return;
      ++left;
      failures += failed;
      out << recording << '\n';
    });
    out.close();
    if (!out) throw PlanUnwritable(to.string() + ": cannot be written; is there room?");
    fs::rename(to.string() + ".part", to);
    failures_before_ = failures_;
    failures_ = failures;
    return left;
  }

  /// A piece was made, or one has failed once more than before.
  [[nodiscard]] bool progress_made(std::size_t before, std::size_t left) const {
    return left < before || failures_ > failures_before_;
  }

  [[nodiscard]] std::string gave_up() const {
    return slurm_ ? "the last " + std::to_string(call_.retries + 1) + " job arrays made nothing: is " +
                        call_.plan.folder.string() + " on a file system that all nodes share, and isorig at " +
                        call_.program.string() + " on each? Their logs are in " + (call_.plan.folder / "slurm").string()
                  : "nothing more could be made";
  }

  std::string here(const fs::path& list, std::size_t left) {
    Progress progress(title_);
    const Done done = make_pieces(shop_, list, {}, call_.jobs, signals_, {}, [&](const Done& now) {
      const std::string words = doing(now, left, fs::path(now.last).filename().string());
      progress.at(static_cast<double>(now.ended) / static_cast<double>(left), words);
      if (now.stopped_by == 0) merges_.maybe(progress, words);
    });
    stopped_by = done.stopped_by;
    return done.cannot_go_on;
  }

  static std::string doing(const Done& now, std::size_t left, const std::string& more) {
    return std::to_string(now.ended) + " of " + std::to_string(left) +
           (now.failed > 0 ? ", " + std::to_string(now.failed) + " failed" : "") + (more.empty() ? "" : ", " + more);
  }

  /// Until the array is gone. `left`: recordings in it; 0: count them.
  std::string wait_for(const Array& array, std::size_t left) {
    if (left == 0) for_each_line(slurm_->list_of(array.number), [&](const std::string&) { ++left; });
    Progress progress(title_);
    bool said = false, first = true;
    for (const auto began = Clock::now();;) {
      const ArrayState state = slurm_->state_of(array);
      const Done now = slurm_->tally_of(array);
      const double fraction = static_cast<double>(now.ended) / static_cast<double>(std::max<std::size_t>(1, left));
      const std::string words =
          doing(now, left, state.at == ArrayState::kNoAnswer ? "Slurm does not answer" : state.words);
      // An array of an earlier call: how long its tasks took for what is there nobody has watched.
      if (std::exchange(first, false)) progress.begins_at(fraction);
      progress.at(fraction, words);
      if (state.at == ArrayState::kGone) return "";
      if (state.at == ArrayState::kNoAnswer && !said)
        std::cerr << caller_of(call_.plan.ask) << ": " << state.words << "; asking again until it answers\n";
      said = state.at == ArrayState::kNoAnswer;
      merges_.maybe(progress, words);
      // A short array is seen to end soon, a long one does not bother slurmctld.
      stopped_by = signals_.wait(std::clamp(0.05 * seconds_since(began), 0.5, 15.0));
      if (stopped_by != 0)
        return "job array " + array.job +
               " goes on without this command: the same command waits for it again, `scancel " + array.job +
               "` ends it";
    }
  }

  const CampaignCall& call_;
  const Signals& signals_;
  const std::string title_;
  Merges merges_;
  Workshop shop_;
  std::optional<Slurm> slurm_;
  std::size_t failures_ = 0, failures_before_ = 0;
};

}  // namespace

CampaignEnd run_campaign(const CampaignCall& call, std::istream& standard_input) {
  fs::create_directories(call.plan.folder);
  const FolderLock lock(call.plan.folder, FolderLock::Of::kCampaign, caller_of(call.plan.ask));
  std::optional<Progress> reading(std::in_place, title_of(call.plan.ask));
  const std::size_t recordings =
      write_plan(call.plan, call.named, standard_input,
                 [&](double fraction, const std::string& doing) { reading->at(fraction, doing); });
  reading.reset();
  const Signals signals;
  Runner runner(call, signals);
  CampaignEnd end;
  end.stopped = runner.run(recordings);
  end.stopped_by = runner.stopped_by;
  for (const char* list : {"todo.txt", "todo-before.txt"}) fs::remove(call.plan.folder / list);
  Progress progress(title_of(call.plan.ask));
  end.standing = merge(call.plan, &call.made,
                       {[&] { return signals.came(); },
                        [&](double fraction, const std::string& doing) { progress.at(fraction, doing); }});
  if (end.standing.stopped) {
    const int number = signals.wait(0.0);
    if (end.stopped_by == 0) end.stopped_by = number;
  }
  return end;
}

void print_failed(const Plan& plan, std::ostream& out) {
  constexpr std::size_t kShown = 10;
  std::size_t shown = 0;
  for_each_line(recordings_of(plan), [&](const std::string& recording) {
    const fs::path folder = failed_folder(plan, recording);
    if (shown >= kShown || fs::exists(piece_folder(plan, recording) / "piece.json") ||
        !fs::exists(folder / "failure.json"))
      return;
    ++shown;
    out << "failed: " << recording << ": see " << folder.string() << '\n';
  });
}

Done run_task(const fs::path& folder, const fs::path& list, Share share, const fs::path& program,
              const std::string& version, std::ostream& out) {
  const Plan plan = read_plan(folder);
  if (plan.program != version)
    throw PlanError(folder.string() + ": a campaign of " + plan.program + ", and this is " + version +
                    "; install the same on every node, or on the shared file system");
  const FolderLock lock(folder, FolderLock::Of::kTask, caller_of(plan.ask));
  const Signals signals;
  const Workshop shop = workshop_of(plan, program);
  Done tally;
  write_tally(list, share, tally);
  return make_pieces(shop, list, share, 1, signals,
                     [&](const std::string& recording, const Attempt& attempt) {
                       ++tally.ended;
                       if (attempt.ended == Ended::kFailed) ++tally.failed;
                       out << recording << ": " << (attempt.ended == Ended::kFailed ? "failed: " : "") << attempt.words
                           << std::endl;
                       write_tally(list, share, tally);
                     },
                     {});
}

}  // namespace isorig::cli::pieces
