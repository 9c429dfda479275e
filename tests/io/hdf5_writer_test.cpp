#include "evmarker/io/hdf5_writer.hpp"

#include <doctest/doctest.h>

#include "io/test_support.hpp"

#ifndef EVMARKER_HAS_HDF5

TEST_CASE("create_hdf5: a build without libhdf5 says how to have it") {
  using namespace evmarker::io;
  const auto error = test::error_of([] { create_hdf5("a.h5", {640, 480}, Hdf5Compression::gzip); });
  CHECK(error.starts_with("a.h5: HDF5 recordings need libhdf5, which this build leaves out: install libhdf5-dev"));
}

#else

#include <sys/resource.h>

#include <csignal>
#include <limits>
#include <stdexcept>

#include "evmarker/io/hdf5_reader.hpp"

using namespace evmarker;
using namespace evmarker::io;
using namespace evmarker::io::test;

namespace {

/// The numbers of a dataset, without the reader; nothing where it is stored in another type.
std::vector<std::int64_t> numbers_in(const std::filesystem::path& path, const char* dataset, hid_t stored_type) {
  const Hdf5Handle file(H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
  const Hdf5Handle data(H5Dopen2(file.get(), dataset, H5P_DEFAULT), H5Dclose);
  const Hdf5Handle type(H5Dget_type(data.get()), H5Tclose), space(H5Dget_space(data.get()), H5Sclose);
  if (H5Tequal(type.get(), stored_type) <= 0) return {};
  std::vector<std::int64_t> numbers(static_cast<std::size_t>(H5Sget_simple_extent_npoints(space.get())));
  H5Dread(data.get(), H5T_NATIVE_INT64, H5S_ALL, H5S_ALL, H5P_DEFAULT, numbers.data());
  return numbers;
}

int filters_of(const std::filesystem::path& path, const char* dataset) {
  const Hdf5Handle file(H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
  const Hdf5Handle data(H5Dopen2(file.get(), dataset, H5P_DEFAULT), H5Dclose);
  const Hdf5Handle creation(H5Dget_create_plist(data.get()), H5Pclose);
  return H5Pget_nfilters(creation.get());
}

/// Files may not grow beyond this while it lives, as on a disk that is full.
class SizeLimit {
 public:
  explicit SizeLimit(rlim_t bytes) : handler_(std::signal(SIGXFSZ, SIG_IGN)) {
    ::getrlimit(RLIMIT_FSIZE, &before_);
    const rlimit limit{bytes, before_.rlim_max};
    ::setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~SizeLimit() {
    ::setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, handler_);
  }
  SizeLimit(const SizeLimit&) = delete;
  SizeLimit& operator=(const SizeLimit&) = delete;

 private:
  void (*handler_)(int);
  rlimit before_{};
};

}  // namespace

TEST_CASE("Hdf5Writer: four datasets that libhdf5 reads, and the reader, whatever the compression") {
  const TemporaryFolder folder;
  auto events = random_events({640, 480}, 200000, 31, true);
  events[7].t = -5;
  std::vector<std::int64_t> x, y, p, t;
  for (const Event& event : events) {
    x.push_back(event.x);
    y.push_back(event.y);
    p.push_back(event.p);
    t.push_back(event.t);
  }
  std::vector<std::uintmax_t> bytes;
  for (const Hdf5Compression compression : {Hdf5Compression::none, Hdf5Compression::gzip}) {
    Hdf5Writer writer(folder / "a.h5", {640, 480}, compression);
    writer.write(std::span(events).first(70000));
    for (const Event& event : std::span(events).subspan(70000, 1000)) writer.write(event);
    CHECK(writer.count_writable(events) == events.size());
    writer.write(std::span(events).subspan(71000));
    CHECK_FALSE(writer.can_write({1, true, 5}));
    writer.close();
    writer.close();
    CHECK(writer.events_written() == events.size());
    CHECK(folder.files() == 1);
    CHECK(numbers_in(folder / "a.h5", "events/x", H5T_STD_U16LE) == x);
    CHECK(numbers_in(folder / "a.h5", "events/y", H5T_STD_U16LE) == y);
    CHECK(numbers_in(folder / "a.h5", "events/p", H5T_STD_U8LE) == p);
    CHECK(numbers_in(folder / "a.h5", "events/t", H5T_STD_I64LE) == t);
    CHECK(filters_of(folder / "a.h5", "events/t") == (compression == Hdf5Compression::none ? 0 : 2));
    Hdf5Reader reader(folder / "a.h5");
    CHECK(reader.sensor_size() == SensorSize{640, 480});
    CHECK(drain(reader) == events);
    bytes.push_back(std::filesystem::file_size(folder / "a.h5"));
  }
  CHECK(bytes[0] > 13 * events.size());
  CHECK(bytes[1] < bytes[0] / 2);
}

TEST_CASE("Hdf5Writer: times are read as microseconds, however few events there are in a second") {
  const TemporaryFolder folder;
  std::vector<Event> events;
  for (int i = 0; i < 2000; ++i) events.push_back({1, 2, 1, 10007 * i});  // as if nanoseconds
  events.push_back({3, 4, -1, std::numeric_limits<Timestamp>::max()});
  Hdf5Writer writer(folder / "a.h5", {640, 480});
  writer.write(events);
  writer.close();
  events.back().p = 0;
  Hdf5Reader reader(folder / "a.h5");
  CHECK(drain(reader) == events);
}

TEST_CASE("Hdf5Writer: the file appears complete or not at all, also without an event") {
  const TemporaryFolder folder;
  write_file(folder / "a.h5", "old");
  {
    Hdf5Writer writer(folder / "a.h5", {10, 10});
    writer.write(Event{1, 2, 1, 3});
    CHECK(std::filesystem::exists(folder / "a.h5.part"));
  }
  CHECK(read_file(folder / "a.h5") == "old");
  CHECK(folder.files() == 1);

  Hdf5Writer writer(folder / "a.h5", {10, 10});
  writer.close();
  CHECK(contains(error_of([&] { writer.write(Event{1, 2, 1, 3}); }), "a.h5: cannot write: the file was closed"));
  Hdf5Reader reader(folder / "a.h5");
  CHECK(reader.sensor_size() == SensorSize{10, 10});
  CHECK(reader.next_batch().empty());
}

TEST_CASE("Hdf5Writer: one clear line for what cannot be written") {
  const TemporaryFolder folder;
  {
    Hdf5Writer writer(folder / "a.h5", {640, 480});
    writer.write(Event{1, 1, 1, 1});
    const auto refuse = [&](const Event& event) {
      return error_of<std::invalid_argument>([&] { writer.write(event); });
    };
    CHECK(contains(refuse({640, 0, 1, 1}), "event 1: x is 640"));
    CHECK(contains(refuse({0, 480, 1, 1}), "event 1: y is 480"));
  }
  const auto open = [&](const std::filesystem::path& path, Hdf5Compression compression = Hdf5Compression::gzip) {
    return error_of([&] { Hdf5Writer(path, {640, 480}, compression); });
  };
  CHECK(contains(error_of<std::invalid_argument>([&] { Hdf5Writer(folder / "a.h5", {0, 480}); }), "width is 0"));
  CHECK(contains(open(folder / "no/such/a.h5"), "a.h5: cannot create: No such file"));
  CHECK(contains(open(folder / "."), "is a directory"));
  CHECK(contains(open("/dev/null"), "/dev/null: HDF5 recordings are written to files alone"));
  CHECK(folder.files() == 0);

  // At the first bytes, between two chunks, and where the last one is to be completed.
  const auto events = random_events({640, 480}, 200000, 32);
  for (const rlim_t bytes : std::vector<rlim_t>{1000, 2500000, 3500000}) {
    const SizeLimit limit(bytes);
    CHECK(contains(error_of([&] {
                     Hdf5Writer writer(folder / "a.h5", {640, 480}, Hdf5Compression::none);
                     writer.write(events);
                     writer.close();
                   }),
                   "a.h5: cannot write: File too large"));
    CHECK(folder.files() == 0);
  }
}

TEST_CASE("Hdf5Writer: zstd needs its plugin, and is named by its registered number") {
  const TemporaryFolder folder;
  constexpr H5Z_filter_t zstd = 32015;
  const bool installed = H5Zfilter_avail(zstd) > 0;
  const auto events = random_events({640, 480}, 5000, 33);
  const auto write = [&] {
    Hdf5Writer writer(folder / "a.h5", {640, 480}, Hdf5Compression::zstd);
    writer.write(events);
    writer.close();
  };
  if (!installed) {
    CHECK(contains(error_of(write), "a.h5: libhdf5 does not find its plugin for zstd (filter 32015)"));
    CHECK(folder.files() == 0);
    const auto identity = [](unsigned, std::size_t, const unsigned*, std::size_t bytes, std::size_t*, void**) {
      return bytes;
    };
    const H5Z_class2_t stand_in{H5Z_CLASS_T_VERS, zstd, 1, 1, "zstd", nullptr, nullptr, identity};
    REQUIRE(H5Zregister(&stand_in) >= 0);
  }
  write();
  {
    Hdf5Reader reader(folder / "a.h5");
    CHECK(drain(reader) == events);
  }
  CHECK(filters_of(folder / "a.h5", "events/t") == 2);
  if (!installed) H5Zunregister(zstd);
}

#endif
