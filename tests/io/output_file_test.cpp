#include "evmarker/io/output_file.hpp"

#include <doctest/doctest.h>

#include <functional>

#include "evmarker/io/csv_writer.hpp"
#include "evmarker/io/pose_writer.hpp"
#include "evmarker/io/raw_writer.hpp"
#include "io/test_support.hpp"

using namespace evmarker;
using namespace evmarker::io;
using namespace evmarker::io::test;

TEST_CASE("OutputFile: a symlink stays, what it leads to is replaced when it is complete") {
  const TemporaryFolder folder;
  std::filesystem::create_directory(folder / "data");
  write_file(folder / "data" / "old.txt", "old");
  std::filesystem::create_symlink("data/old.txt", folder / "link");
  std::filesystem::create_symlink(folder / "link", folder / "link_to_link");
  std::filesystem::create_symlink("data/new.txt", folder / "to_nothing");
  for (const char* name : {"link", "link_to_link", "to_nothing"}) {
    CAPTURE(name);
    const auto target = folder / "data" / (name == std::string("to_nothing") ? "new.txt" : "old.txt");
    const bool existed = std::filesystem::exists(target);
    {
      OutputFile file(folder / name);
      file.write(std::string_view("lost"));
    }
    CHECK(std::filesystem::exists(target) == existed);
    OutputFile file(folder / name);
    file.write(std::string_view(name));
    CHECK(std::filesystem::exists(target) == existed);
    file.close();
    CHECK(std::filesystem::is_symlink(folder / name));
    CHECK(std::filesystem::is_regular_file(std::filesystem::symlink_status(target)));
    CHECK(read_file(target) == name);
  }
  CHECK(folder.files() == 4);  // the links and the folder, and no part of any
  CHECK(std::distance(std::filesystem::directory_iterator(folder / "data"), {}) == 2);

  std::filesystem::create_symlink("circle", folder / "circle");
  CHECK(contains(error_of([&] { OutputFile(folder / "circle"); }), "circle: cannot create"));
}

TEST_CASE("OutputFile: nothing is written after close, and every writer says so") {
  const TemporaryFolder folder;
  const auto refuses_after_close = [&](auto writer, const auto& item) {
    writer.write(item);
    writer.close();
    const std::string error = error_of([&] { writer.write(item); });
    CHECK_MESSAGE(contains(error, "closed: cannot write: the file was closed"), error);
    writer.close();
  };
  const Event event{1, 2, 1, 3};
  refuses_after_close(RawWriter(folder / "closed", {10, 10}), event);
  refuses_after_close(CsvWriter(folder / "closed", {10, 10}), event);
  refuses_after_close(PoseCsvWriter(folder / "closed"), PoseEstimate{});
  refuses_after_close(TumWriter(folder / "closed"), PoseEstimate{});
  RawWriter raw(folder / "closed", {10, 10});
  raw.close();
  CHECK(contains(error_of([&] { raw.write_trigger({}); }), "closed"));
  CHECK(raw.events_written() == 0);
  CHECK(folder.files() == 1);
}
