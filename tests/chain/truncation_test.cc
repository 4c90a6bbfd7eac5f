// Files of a real run, cut at random places: an error, or a complete model. S3LAM_TEST_CUTS says
// how many places a file is cut at (default: 60).

#include <cstdlib>
#include <functional>

#include "chain/chain_support.h"
#include "s3lam/base/error.h"
#include "s3lam/base/rng.h"
#include "s3lam/io/colmap_model.h"
#include "s3lam/io/descriptors.h"
#include "s3lam/io/frame_observations.h"
#include "s3lam/io/keypoint_sigmas.h"
#include "s3lam/io/semantic_map_io.h"
#include "support/temp_dir.h"

namespace s3lam {
namespace {

namespace fs = std::filesystem;
using testing::ChainFolder;
using testing::FileBytes;
using testing::TempDir;

size_t NumCuts() {
  const char* text = std::getenv("S3LAM_TEST_CUTS");
  return text == nullptr ? 60 : std::strtoul(text, nullptr, 10);
}

/// Reads `folder` with one file of it cut at random places; `read` must refuse it each time.
void ExpectRefusedWhereverCut(const fs::path& folder, const std::string& name,
                              const std::function<void(const fs::path&)>& read) {
  const TempDir dir;
  fs::copy(folder, dir / "folder", fs::copy_options::recursive);
  ASSERT_NO_THROW(read(dir / "folder")) << name;
  const std::string whole = FileBytes(folder / name);
  Rng rng(7);
  for (size_t i = 0; i < NumCuts(); ++i) {
    const size_t size =
        rng.Below(whole.size() - 1);  // The last byte of a text may be a line break.
    dir.Write(fs::path("folder") / name, std::string_view(whole).substr(0, size));
    EXPECT_THROW(read(dir / "folder"), InputError) << name << " cut to " << size << " bytes";
  }
}

TEST(Truncation, BinaryModels) {
  for (const char* name : {"cameras.bin", "images.bin", "points3D.bin"}) {
    ExpectRefusedWhereverCut(ChainFolder("1_slam"), name,
                             [](const fs::path& folder) { ReadColmapModel(folder); });
  }
}

TEST(Truncation, TextModels) {
  const TempDir dir;
  WriteColmapModelText(ReadColmapModel(ChainFolder("1_slam")), dir.path());
  for (const char* name : {"cameras.txt", "images.txt", "points3D.txt"}) {
    ExpectRefusedWhereverCut(dir.path(), name,
                             [](const fs::path& folder) { ReadColmapModel(folder); });
  }
}

TEST(Truncation, FilesBesideTheModel) {
  ExpectRefusedWhereverCut(ChainFolder("1_slam"), "descriptors.bin", [](const fs::path& folder) {
    ReadDescriptors(folder / "descriptors.bin");
  });
  ExpectRefusedWhereverCut(ChainFolder("1_slam"), "observations.bin", [](const fs::path& folder) {
    ReadFrameObservations(folder / "observations.bin");
  });
  ExpectRefusedWhereverCut(
      ChainFolder("1_slam"), "keypoint_sigmas.bin",
      [](const fs::path& folder) { ReadKeypointSigmas(folder / "keypoint_sigmas.bin"); });
}

TEST(Truncation, SemanticMaps) {
  for (const char* name : {"semantics.json", "distributions.npy"}) {
    ExpectRefusedWhereverCut(ChainFolder("2_lift_clean"), name,
                             [](const fs::path& folder) { ReadSemanticMap(folder); });
  }
}

}  // namespace
}  // namespace s3lam
