#include <cstdio>

#include "fault_matrix_expect.hpp"

int main() {
  const auto page = isorig::daemon::test::faults_page();
  return std::fwrite(page.data(), 1, page.size(), stdout) == page.size() ? 0 : 1;
}
