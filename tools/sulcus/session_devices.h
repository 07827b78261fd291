// The devices of a session, by what the command line says.
#pragma once

#include <memory>
#include <vector>

#include "engine/device/device.h"
#include "hw_phantom/phantom.h"
#include "scenarios/loader/scenario.h"
#include "tools/sulcus/commands.h"

namespace sulcus {

struct SessionDevice {
  std::unique_ptr<Device> device;
  bool leads = true;           // the session ends with it
  bool place_at_tool = false;  // its pose at the start becomes the tool's (a stylus in a hand)
};

// One a tool. Throws InputError for options that do not fit each other or the scenario.
std::vector<SessionDevice> make_session_devices(const SessionOptions& options, const Scenario& scenario);

PhantomSettings phantom_settings(const PhantomOptions& options);

}  // namespace sulcus
