// Stands for the vendor's I/O library, which is then not there: for the test of a missing dependency.
extern "C" __attribute__((visibility("default"))) int phantom_io() {
  return 0;
}
