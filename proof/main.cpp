#include <cstdio>
#include <exception>

#include "proof/commands.hpp"

int main(int argc, char** argv) {
  CLI::App app{"The concealed-effect study: hide physics in a rig of its own, and score what a diagnosis finds"};
  app.require_subcommand(1);
  isorig::proof::add_generate(app);
  isorig::proof::add_run(app);
  isorig::proof::add_score(app);
  isorig::proof::add_score_practice(app);
  isorig::proof::add_case(app);
  isorig::proof::add_task(app);
  isorig::proof::add_sensitivity(app);
  isorig::proof::add_real(app);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    constexpr int kUsage = 2;
    return app.exit(error) == 0 ? 0 : kUsage;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
  return 0;
}
