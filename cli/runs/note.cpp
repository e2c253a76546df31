#include <iostream>
#include <memory>
#include <string>

#include "base/text_file.hpp"
#include "cli/command.hpp"
#include "cli/protocols/protocol_input.hpp"
#include "cli/rig/client.hpp"
#include "daemon/host/corrections.hpp"
#include "daemon/host/paths.hpp"
#include "daemon/recording/catalogue.hpp"

/// isorig note: puts right what is known of a run, with a trace. The recording stays as it was.
namespace isorig::cli {
namespace {

struct NoteOptions {
  daemon::Correction correction;
  std::string specimen_file;
  std::string runs;
  std::string socket = daemon::default_socket().string();
};

int note(NoteOptions o) {
  auto& c = o.correction;
  if (!o.specimen_file.empty()) {
    c.specimen_text = base::read_config_file(o.specimen_file);
    c.specimen_name = o.specimen_file;
  }
  if (!o.runs.empty()) {
    daemon::Catalogue catalogue(o.runs);
    const auto run = catalogue.find_run(c.run);
    if (!run) throw std::runtime_error("there is no run \"" + c.run + "\" in " + o.runs + "; `isorig runs` lists them");
    std::cout << daemon::amend_run(catalogue, *run, c) << '\n';
    return kOk;
  }
  try {
    const auto answer = Client(o.socket).post("/v1/notes", {{"run", c.run},
                                                            {"by", c.by},
                                                            {"operator", c.operator_name},
                                                            {"specimen", c.specimen_text},
                                                            {"specimen_name", c.specimen_name},
                                                            {"text", c.text}});
    (answer.ok() ? std::cout : std::cerr) << answer.text() << '\n';
    return answer.ok() ? kOk : answer.status == 400 ? kBadInput : kRefused;
  } catch (const NoDaemon& e) {
    std::cerr << "isorig: " << e.what() << "; or name the runs' folder to write there directly: --runs\n";
    return kNoDaemon;
  }
}

Command add_note(CLI::App& app) {
  auto o = std::make_shared<NoteOptions>();
  auto* sub = app.add_subcommand("note", "Put right what is known of a run: its specimen, its operator, a remark");
  sub->add_option("RUN", o->correction.run, "Name of a run, the beginning of it, or \"latest\"")->required();
  sub->add_option("--specimen", o->specimen_file, "File of the specimen that it was");
  sub->add_option("--operator", o->correction.operator_name, "Who ran it");
  sub->add_option("--text", o->correction.text, "A remark");
  sub->add_option("--by", o->correction.by, "Who notes this");
  sub->add_option("--runs", o->runs, "Write into this folder of runs, without a daemon");
  sub->add_option("--socket", o->socket, "The daemon's socket")->capture_default_str();
  return {sub, [o] { return note(*o); }};
}

const Registration kNote(45, add_note);

}  // namespace
}  // namespace isorig::cli
