#pragma once
#include <CLI/CLI.hpp>

namespace isorig::proof {

void add_generate(CLI::App& app);
void add_run(CLI::App& app);
void add_score(CLI::App& app);
void add_score_practice(CLI::App& app);
void add_case(CLI::App& app);
void add_task(CLI::App& app);
void add_sensitivity(CLI::App& app);
void add_real(CLI::App& app);

}  // namespace isorig::proof
