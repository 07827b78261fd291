// For tests: something is refused, with these words in the message.
#pragma once

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "engine/numerics/error.h"

namespace sulcus {

template <class Action>
void expect_refusal(Action&& action, const std::vector<std::string>& words) {
  try {
    action();
    FAIL() << "nothing was refused";
  } catch (const InputError& error) {
    const std::string message = error.what();
    for (const std::string& word : words) EXPECT_NE(message.find(word), std::string::npos) << message;
  }
}

}  // namespace sulcus
