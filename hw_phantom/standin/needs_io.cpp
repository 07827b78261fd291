extern "C" int phantom_io();
extern "C" __attribute__((visibility("default"))) unsigned hdInitDevice(const char*) {
  return static_cast<unsigned>(phantom_io());
}
