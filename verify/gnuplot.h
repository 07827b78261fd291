// gnuplot as a program: what charts in pages and pictures share.
#pragma once

#include <string>

namespace sulcus {

// Runs a script and returns what it writes to standard output: the drawing, of the terminal that the script
// sets. The user's own gnuplot settings do not matter. Throws EnvironmentError if gnuplot is missing or
// fails, with the remedy.
std::string draw_with_gnuplot(const std::string& script);

// A text and a number as they stand in a script.
std::string gnuplot_text(const std::string& text);
std::string gnuplot_number(double value);

}  // namespace sulcus
