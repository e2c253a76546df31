// Writes isorig's manual page and its completions from what the program itself says of its commands and options, so
// that neither can lag behind. Runs at build time; not installed.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <string>

#include "cli/command.hpp"
#include "cli/reference_parts.hpp"

namespace {

using isorig::cli::Command;
using namespace isorig::cli::reference;

constexpr const char* kDescription =
    R"(.B isorig
compiles and checks protocols, operates a rig through its daemon
.BR isorigd (8),
lists, shows and exports what was recorded, and analyses recordings: force\-velocity curves, and what a model of the
actuator leaves out.
.PP
Protocols, rigs and specimens are TOML files; examples are in
.I /usr/share/isorig
and, for the daemon, in
.IR /etc/isorig .
Quantities are in mm, N, psi and s, extension and tension positive, pressures gauge.
)";

constexpr const char* kEnd =
    R"(.SH EXAMPLES
A protocol that is looked through, run in virtual time on a simulated rig, listed, exported and analysed:
.PP
.nf
.RS
cd /usr/share/isorig
isorig check protocols/vma\-short.toml \-\-rig rigs/sim.toml
isorig run protocols/vma\-short.toml \-\-rig rigs/sim.toml \-\-runs ~/runs
isorig runs \-\-runs ~/runs
isorig export latest \-\-runs ~/runs \-\-out ~/recordings
isorig fv ~/recordings/* \-\-out ~/fv
isorig diagnose ~/recordings/rep\-1_10\-psi \-\-model slse1 \-\-out ~/diagnosis
.RE
.fi
.PP
The same on the daemon's rig, until it is done; then what is left of it when it was not:
.PP
.nf
.RS
isorig start protocols/vma\-smoke.toml \-\-operator "R. Hooke" \-\-until\-done
isorig watch
isorig resume 20260301\-101500\-vma\-isovelocity\-M1
.RE
.fi
.PP
For an editor that completes TOML by JSON Schema:
.PP
.nf
.RS
isorig schema rig > rig.schema.json
.RE
.fi
.SH EXIT STATUS
.TS
r l.
0	ok
1	failure
2	usage
3	bad input: everything wrong with it is listed
4	no daemon answers
5	the daemon refused, and said why
6	the run tripped a limit or an interlock
7	data were lost
.TE
.SH ENVIRONMENT
.TP
.B ISORIG_SOCKET
The daemon's control socket, instead of
.IR /run/isorig/isorigd.sock .
.TP
.B ISORIG_RUNS
Where runs are kept, instead of
.I ./runs
or, for commands that only read, the service's
.IR /var/lib/isorig/runs .
.SH FILES
.TP
.I /run/isorig/isorigd.sock
The service's control socket. Its users are in the group
.BR isorig .
.TP
.I /var/lib/isorig/runs
The service's recordings and their catalogue.
.TP
.I /usr/share/isorig/protocols
Protocols to start from.
.TP
.I /usr/share/isorig/firmware
The firmware of the rig's Teensy 3.6, and how to flash it.
.SH SEE ALSO
.BR isorigd (8),
.BR isorig\-simrig (1)
)";

std::string roff(const std::string& text) {
  std::string out;
  bool line_begins = true;
  for (const char c : text) {
    if (line_begins && (c == '.' || c == '\'')) out += "\\&";
    line_begins = c == '\n';
    if (c == '\\') {
      out += "\\e";
    } else if (c == '-') {
      out += "\\-";
    } else {
      out += c;
    }
  }
  return out;
}

std::string bold(const std::string& text) {
  return "\\fB" + roff(text) + "\\fR";
}
std::string italic(const std::string& text) {
  return "\\fI" + roff(text) + "\\fR";
}

bool repeats(const CLI::Option& option) {
  return option.get_items_expected_max() > 1;
}

std::string value_of(const CLI::Option& option) {
  if (!takes_value(option)) return "";
  std::string choices;
  for (const auto& choice : choices_of(option)) choices += (choices.empty() ? "" : "|") + choice;
  if (!choices.empty()) return choices;
  const std::string type = option.get_type_name();
  return type.empty() ? "VALUE" : type.substr(0, type.find(':'));
}

void print_option(const CLI::Option& option) {
  std::cout << ".TP\n";
  std::string names;
  for (const auto& s : option.get_snames()) names += (names.empty() ? "" : ", ") + bold("-" + s);
  for (const auto& l : option.get_lnames()) names += (names.empty() ? "" : ", ") + bold("--" + l);
  if (const auto value = value_of(option); !value.empty()) names += " " + italic(value);
  std::cout << names << '\n' << roff(option.get_description());
  if (option.get_required()) std::cout << " (required)";
  if (!option.get_default_str().empty()) std::cout << " (default: " << roff(option.get_default_str()) << ')';
  std::cout << '\n';
}

void print_command(const CLI::App& app, const std::string& prefix) {
  const std::string name = prefix + app.get_name();
  std::cout << ".SS " << bold(name);
  const auto options = options_of(app, false);
  if (!options.empty()) std::cout << " [" << italic("options") << ']';
  for (const auto* p : options_of(app, true)) {
    const std::string word = italic(positional_name(*p)) + (repeats(*p) ? "..." : "");
    std::cout << ' ' << (p->get_required() ? word : "[" + word + "]");
  }
  std::cout << '\n' << roff(app.get_description()) << ".\n";
  for (const auto* p : options_of(app, true)) {
    std::cout << ".TP\n" << italic(positional_name(*p)) << '\n' << roff(p->get_description()) << '\n';
  }
  for (const auto* o : options) print_option(*o);
  for (const auto* sub : commands_of(app)) print_command(*sub, name + " ");
}

void print_manual(const CLI::App& app, const std::vector<Command>& commands, const std::string& version,
                  const std::string& date) {
  std::cout << "'\\\" t\n.TH ISORIG 1 " << date << " \"isorig " << version << "\" \"isorig\"\n"
            << ".SH NAME\nisorig \\- "
            << "operate an iso\\-velocity rig and analyse its recordings\n"
            << ".SH SYNOPSIS\n.B isorig\n.I command\n[\\,\\fIoptions\\fR\\/] [\\,\\fIarguments\\fR\\/]\n.br\n"
            << ".B isorig\n[\\,\\fIcommand\\fR\\/] \\fB\\-\\-help\\fR\n"
            << ".SH DESCRIPTION\n"
            << kDescription << ".SH OPTIONS\n.TP\n"
            << bold("-h") << ", " << bold("--help") << "\nHelp on the program, or on the command before it.\n";
  for (const auto* o : options_of(app, false)) print_option(*o);
  std::cout << ".SH COMMANDS\n";
  for (const auto& command : commands) {
    if (!command.app->get_group().empty()) print_command(*command.app, "");
  }
  std::cout << kEnd;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string what = argc > 1 ? argv[1] : "";
  // The defaults that the options show are those of an installed rig, not of whoever builds.
  ::setenv("ISORIG_SOCKET", "/run/isorig/isorigd.sock", 1);
  ::unsetenv("ISORIG_RUNS");
  CLI::App app;
  const auto commands = isorig::cli::build(app);
  if (what == "manual" && argc == 4) {
    print_manual(app, commands, argv[2], argv[3]);
  } else if (const std::string shell = what == "completion" && argc == 3 ? argv[2] : ""; shell == "bash") {
    print_bash(app);
  } else if (shell == "zsh") {
    print_zsh(app);
  } else if (shell == "fish") {
    print_fish(app);
  } else {
    std::cerr << "usage: isorig-reference manual VERSION DATE | completion bash|zsh|fish\n";
    return 2;
  }
  return 0;
}
