// Inside the stand-in: its one simulated world, behind one lock that is never held while a callback runs.
#pragma once

#include <array>
#include <condition_variable>
#include <mutex>
#include <set>
#include <thread>
#include <vector>

#include "hw_phantom/hdapi.h"
#include "hw_phantom/standin/control.h"

namespace sulcus::standin {

inline constexpr int device_count = 2;
inline constexpr const char* device_names[device_count] = {"Default Device", "Second Device"};

struct SimulatedDevice {
  bool initialised = false, frame_open = false, dead_joints = false, updated = false;
  std::uint64_t frame_tick = 0;  // of the newest frame
  std::set<unsigned int> enabled;
  Motion motion{};
  double joints[3] = {}, gimbals[3] = {};
  double transform[16] = {}, velocity[3] = {}, force[3] = {}, torque[3] = {}, last_force[3] = {};
  bool force_set = false;
  Observation seen{};
};

struct ScheduledCallback {
  unsigned long operation;
  hd::Callback function;
  void* user;
  unsigned short priority;
};

struct World {
  std::mutex mutex;
  Faults faults{};
  std::array<SimulatedDevice, device_count> devices;
  hd::Handle current = hd::invalid_handle;
  std::vector<hd::ErrorRecord> errors;
  std::vector<ScheduledCallback> callbacks, due;  // due: of the tick that runs
  unsigned long next_operation = 1;
  bool manual = false, running = false;
  std::uint64_t tick = 0;
  double clock_s = 0, next_tick_s = 0, tick_start_s = 0;
  std::uint64_t random = 1;
  int inits_failed = 0;
  std::uint64_t errors_pushed = 0;
  std::thread thread;
  std::thread::id servo_thread;
  std::condition_variable changed;
  Log* log = nullptr;
};

World& world();

// All with the lock held.
void push(World& w, unsigned int code, int internal = 0);
SimulatedDevice* current_device(World& w);  // pushes 0x0104 and gives null if there is none
void sample(World& w, SimulatedDevice& device);
void finish_frame(World& w, SimulatedDevice& device);
unsigned int calibration(const World& w, const SimulatedDevice& device);
double next_period(World& w);

void run_tick(World& w);  // without the lock
void start(World& w);
void stop(World& w);

}  // namespace sulcus::standin
