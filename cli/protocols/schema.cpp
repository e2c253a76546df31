#include <stdlib.h>

#include <filesystem>
#include <fstream>
#include <iostream>
#include <memory>

#include "cli/command.hpp"
#include "cli/protocols/schema_of_readers.hpp"
#include "daemon/rig/config.hpp"
#include "daemon/rig/specimen.hpp"
#include "protocol/compile.hpp"
#include "protocol/plan.hpp"
#include "sim/specimen.hpp"

/// isorig schema: what a file of a kind may hold, for editors.
namespace isorig::cli {
namespace {

/// For readers that want a path. Gone with this.
class ProbeFolder {
 public:
  ProbeFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "isorig-schema-XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) throw std::runtime_error("cannot make a folder in " + name);
    path_ = name;
  }
  ~ProbeFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  ProbeFolder(const ProbeFolder&) = delete;
  ProbeFolder& operator=(const ProbeFolder&) = delete;

  template <typename Read>
  ReadText of(Read read) const {
    return [read, this](const std::string& text, const std::string& name) {
      std::ofstream(path_ / name, std::ios::binary) << text;
      read(path_ / name);
    };
  }

 private:
  std::filesystem::path path_;
};

int print(const std::string& kind) {
  const ProbeFolder folder;
  nlohmann::ordered_json schema;
  if (kind == "rig") {
    // Both sides of a rig are simulated, or neither is: no single key leads from the one to the other.
    schema = schema_of(
        "isorig rig", {folder.of([](const auto& file) { (void)daemon::load_rig(file); })},
        {"", "[frame]\ndriver = \"sim\"\n[pressure]\ndriver = \"sim\"\n[interlock]\ndriver = \"sim\"\n[sim]\n"});
  } else if (kind == "protocol") {
    std::string seed = "steps = [ { do = \"repeat\" }";
    for (const auto step : {protocol::StepKind::kPressurize, protocol::StepKind::kSettle, protocol::StepKind::kRamp,
                            protocol::StepKind::kHold, protocol::StepKind::kWave, protocol::StepKind::kMark}) {
      seed += ", { do = \"" + std::string(protocol::name_of(step)) + "\" }";
    }
    schema = schema_of("isorig protocol", {[](const std::string& text, const std::string& name) {
                         (void)protocol::compile(base::TomlDocument::parse_text(text, name));
                       }},
                       {"", seed + " ]\n"});
  } else {
    schema =
        schema_of("isorig specimen",
                  {[](const std::string& text, const std::string& name) { (void)daemon::parse_specimen(text, name); },
                   folder.of([](const auto& file) { (void)sim::load_specimen(file); })},
                  {""});
  }
  std::cout << schema.dump(2) << '\n';
  return kOk;
}

Command add_schema(CLI::App& app) {
  auto kind = std::make_shared<std::string>();
  auto* sub = app.add_subcommand("schema", "JSON Schema of a kind of file, by which an editor completes and checks");
  sub->add_option("KIND", *kind, "rig, protocol or specimen")
      ->required()
      ->check(CLI::IsMember({"rig", "protocol", "specimen"}));
  return {sub, [kind] { return print(*kind); }};
}

const Registration kSchema(3, add_schema);

}  // namespace
}  // namespace isorig::cli
