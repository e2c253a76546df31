// Completion for bash, zsh and fish, from the same registrations.
#include <algorithm>
#include <cctype>
#include <iostream>

#include "cli/reference_parts.hpp"

namespace isorig::cli::reference {
namespace {

/// Names of runs, one a line.
constexpr const char* kRuns = R"sed(isorig runs --json 2>/dev/null | sed -n 's/^ *"id": "\([^"]*\)".*/\1/p')sed";

std::string joined(const std::vector<std::string>& words) {
  std::string out;
  for (const auto& word : words) out += (out.empty() ? "" : " ") + word;
  return out;
}

bool completes_runs(const CLI::App& app) {
  const auto positionals = options_of(app, true);
  return !positionals.empty() && positional_name(*positionals.front()) == "RUN";
}

/// One `case` arm per command path: its options, the values of those that take one, and what its arguments are.
void print_arm(const CLI::App& app, const std::string& path) {
  std::string words = "--help", values;
  std::cout << "    '" << path << "')\n";
  for (const auto* o : options_of(app, false)) {
    for (const auto& l : o->get_lnames()) {
      words += " --" + l;
      if (!takes_value(*o)) continue;
      const auto choices = joined(choices_of(*o));
      values += "        --" + l + ") values='" + (choices.empty() ? "@file" : choices) + "' ;;\n";
    }
  }
  const char* arguments = options_of(app, true).empty() ? "" : completes_runs(app) ? "@run" : "@file";
  std::vector<std::string> commands;
  for (const auto* sub : commands_of(app)) commands.push_back(sub->get_name());
  std::cout << "      options='" << words << "' commands='" << joined(commands) << "' arguments='" << arguments
            << "'\n";
  if (!values.empty()) std::cout << "      case $1 in\n" << values << "      esac\n";
  std::cout << "      ;;\n";
  for (const auto* sub : commands_of(app)) print_arm(*sub, path_below(path, *sub));
}

/// Inside single quotes of a shell.
std::string quoted(const std::string& text, const std::string& escaped = {}) {
  std::string out = "'";
  for (const char c : text) {
    if (c == '\'') {
      out += "'\\''";
      continue;
    }
    if (escaped.find(c) != std::string::npos) out += '\\';
    out += c;
  }
  return out + "'";
}

std::string function_of(const std::string& path) {
  std::string out = "_isorig";
  for (const char c : path.empty() ? path : " " + path)
    out += std::isalnum(static_cast<unsigned char>(c)) != 0 ? c : '_';
  return out;
}

/// The specifications of _arguments(zshcompsys): '--rig[words]:RIG:_files'.
void print_zsh_options(const CLI::App& app) {
  constexpr const char* kSpecial = "[]:\\";
  std::cout << "    '--help[help on this]'";
  for (const auto* o : options_of(app, false)) {
    for (const auto& l : o->get_lnames()) {
      std::string value;
      if (takes_value(*o)) {
        const auto choices = choices_of(*o);
        value = ":" + l + ":" + (choices.empty() ? "_files" : "(" + joined(choices) + ")");
      }
      const bool repeats = o->get_items_expected_max() > 1;
      std::string description;
      for (const char c : o->get_description()) {
        if (std::string(kSpecial).find(c) != std::string::npos) description += '\\';
        description += c;
      }
      std::cout << " \\\n    " << quoted((repeats ? "*--" : "--") + l + "[" + description + "]" + value);
    }
  }
}

void print_zsh_function(const CLI::App& app, const std::string& path) {
  const auto commands = commands_of(app);
  std::cout << function_of(path) << "() {\n";
  if (commands.empty()) {
    std::cout << "  _arguments -s \\\n";
    print_zsh_options(app);
    if (!options_of(app, true).empty()) {
      std::cout << " \\\n    " << (completes_runs(app) ? "'1:run:_isorig__runs'" : "'*:file:_files'");
    }
    std::cout << "\n}\n";
    return;
  }
  std::cout << "  local curcontext=$curcontext state line\n  typeset -A opt_args\n  _arguments -C \\\n";
  print_zsh_options(app);
  std::cout << " \\\n    '1: :->command' '*:: :->rest'\n  case $state in\n    command)\n      local -a commands=(\n";
  for (const auto* sub : commands) {
    std::cout << "        " << quoted(sub->get_name() + ":" + sub->get_description()) << '\n';
  }
  std::cout << "      )\n      _describe command commands ;;\n    rest)\n      case $line[1] in\n";
  for (const auto* sub : commands) {
    std::cout << "        " << sub->get_name() << ") " << function_of(path_below(path, *sub)) << " ;;\n";
  }
  std::cout << "      esac ;;\n  esac\n}\n";
  for (const auto* sub : commands) print_zsh_function(*sub, path_below(path, *sub));
}

/// One `complete` per option and command; -n says under which words of the line it is offered.
void print_fish_lines(const CLI::App& app, const std::string& condition) {
  const auto with = " -n " + quoted(condition.empty() ? "__fish_use_subcommand" : condition);
  for (const auto* o : options_of(app, false)) {
    for (const auto& l : o->get_lnames()) {
      std::cout << "complete -c isorig" << with << " -l " << l;
      for (const auto& s : o->get_snames()) std::cout << " -s " << s;
      if (takes_value(*o)) {
        const auto choices = choices_of(*o);
        std::cout << (choices.empty() ? " -r -F" : " -x -a " + quoted(joined(choices)));
      }
      std::cout << " -d " << quoted(o->get_description(), "\\") << '\n';
    }
  }
  if (!condition.empty() && !options_of(app, true).empty()) {
    std::cout << "complete -c isorig" << with << (completes_runs(app) ? " -a '(__isorig_runs)'" : " -F") << '\n';
  }
  const auto commands = commands_of(app);
  std::vector<std::string> names;
  for (const auto* sub : commands) names.push_back(sub->get_name());
  const std::string none_yet = condition.empty() ? "__fish_use_subcommand"
                                                 : condition + "; and not __fish_seen_subcommand_from " + joined(names);
  for (const auto* sub : commands) {
    std::cout << "complete -c isorig -n " << quoted(none_yet) << " -a " << sub->get_name() << " -d "
              << quoted(sub->get_description(), "\\") << '\n';
    print_fish_lines(
        *sub, (condition.empty() ? "" : condition + "; and ") + "__fish_seen_subcommand_from " + sub->get_name());
  }
}

}  // namespace

void print_bash(const CLI::App& app) {
  std::cout << R"(# bash completion for isorig, made from the program's own commands and options
_isorig_of() {  # <word before> <command path>: sets options, commands, arguments, values
  options= commands= arguments= values=
  case $2 in
)";
  print_arm(app, "");
  std::cout << R"sh(  esac
}

_isorig() {
  local cur=${COMP_WORDS[COMP_CWORD]} prev=${COMP_WORDS[COMP_CWORD-1]}
  local path= i options commands arguments values
  for ((i = 1; i < COMP_CWORD; ++i)); do
    _isorig_of '' "$path"
    if [[ " $commands " == *" ${COMP_WORDS[i]} "* ]]; then
      path=${path:+$path }${COMP_WORDS[i]}
    fi
  done
  _isorig_of "$prev" "$path"
  COMPREPLY=()
  if [[ -n $values ]]; then
    [[ $values == @file ]] || { mapfile -t COMPREPLY < <(compgen -W "$values" -- "$cur"); return; }
    compopt -o default 2>/dev/null
  elif [[ $cur == -* ]]; then
    mapfile -t COMPREPLY < <(compgen -W "$options" -- "$cur")
  elif [[ -n $commands ]]; then
    mapfile -t COMPREPLY < <(compgen -W "$commands" -- "$cur")
  elif [[ $arguments == @run ]]; then
    mapfile -t COMPREPLY < <(compgen -W "latest $()sh"
            << kRuns << R"sh()" -- "$cur")
  elif [[ $arguments == @file ]]; then
    compopt -o default 2>/dev/null
  fi
}
complete -F _isorig isorig
)sh";
}

void print_zsh(const CLI::App& app) {
  std::cout << "#compdef isorig\n# zsh completion for isorig, made from the program's own commands and options\n"
            << "_isorig__runs() {\n  local -a runs=(latest ${(f)\"$(" << kRuns << ")\"})\n  compadd -a runs\n}\n";
  print_zsh_function(app, "");
  std::cout << "_isorig \"$@\"\n";
}

void print_fish(const CLI::App& app) {
  std::cout
      << "# fish completion for isorig, made from the program's own commands and options\n"
      << "function __isorig_runs\n  echo latest\n  " << kRuns << "\nend\n"
      << "complete -c isorig -f\ncomplete -c isorig -l help -d 'Help on the program, or on the command before it'\n";
  print_fish_lines(app, "");
}

}  // namespace isorig::cli::reference
