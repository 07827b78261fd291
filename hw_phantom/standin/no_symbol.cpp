// A library of the right name that is not the driver: for the test of a missing symbol.
extern "C" __attribute__((visibility("default"))) unsigned hdInitDevice(const char*) {
  return 0;
}
