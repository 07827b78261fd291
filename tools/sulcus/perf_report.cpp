// `sulcus perf-report`: trend lines of the history of performance.
#include <cstdio>

#include "tools/sulcus/commands.h"
#include "verify/check.h"
#include "verify/performance.h"

namespace sulcus {

int perf_report_command(const PerfReportOptions& options) {
  write_file_atomically(options.out, performance_html(options.history));
  std::printf("%s\n", std::filesystem::absolute(options.out).lexically_normal().c_str());
  return 0;
}

}  // namespace sulcus
