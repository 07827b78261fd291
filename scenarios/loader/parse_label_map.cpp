#include "scenarios/loader/parse_label_map.h"

#include "scenarios/loader/images.h"

namespace sulcus {

namespace {

LabelMapSource read_generated(const json& generate) {
  if (generate.contains("cylinder_three_segments")) {
    const json& object = generate["cylinder_three_segments"];
    CylinderThreeSegments shape;
    read_mm(object, "diameter_mm", shape.diameter_m);
    read_mm(object, "length_mm", shape.length_m);
    read_mm(object, "voxel_size_mm", shape.voxel_size_m);
    read_mm(object, "gap_mm", shape.gap_m);
    read_mm(object, "gap_from_y_mm", shape.gap_from_y_m);
    return shape;
  }
  if (generate.contains("box")) {
    BoxSegment shape;
    read_mm(generate["box"], "size_mm", shape.size_m);
    read_mm(generate["box"], "voxel_size_mm", shape.voxel_size_m);
    read(generate["box"], "label", shape.label);
    return shape;
  }
  if (generate.contains("balls")) {
    const json& object = generate["balls"];
    BallsSegment shape;
    for (const json& entry : object["balls"]) {
      BallsSegment::Ball& ball = shape.balls.emplace_back();
      read_mm(entry, "centre_mm", ball.centre_m);
      read_mm(entry, "radius_mm", ball.radius_m);
    }
    read_mm(object, "blend_mm", shape.blend_m);
    read_mm(object, "voxel_size_mm", shape.voxel_size_m);
    read(object, "label", shape.label);
    return shape;
  }
  if (generate.contains("drawing")) {
    DrawnSegments drawing;
    read(generate["drawing"], "rows", drawing.rows);
    read_mm(generate["drawing"], "voxel_size_mm", drawing.voxel_size_m);
    drawing.thickness_m = drawing.voxel_size_m;
    read_mm(generate["drawing"], "thickness_mm", drawing.thickness_m);
    return drawing;
  }
  SphereSegment shape;
  read_mm(generate["sphere"], "diameter_mm", shape.diameter_m);
  read_mm(generate["sphere"], "voxel_size_mm", shape.voxel_size_m);
  read(generate["sphere"], "label", shape.label);
  return shape;
}

}  // namespace

void check_box(const Vec3& min_m, const Vec3& max_m, const std::string& pointer, Problems& problems) {
  if (!(min_m.array() <= max_m.array()).all()) {
    problems.push_back(pointer + ": max is less than min along an axis; swap them");
  }
}

void read_label_map(const json& object, const std::filesystem::path& directory, Scenario& scenario,
                    std::string& missing, Problems& problems) {
  if (object.contains("file") == object.contains("generate")) {
    problems.push_back("/label_map: expected exactly one of \"file\" and \"generate\"");
    return;
  }
  if (object.contains("file")) {
    const std::filesystem::path file = directory / object["file"].get<std::string>();
    scenario.map_source = file;
    if (std::error_code error; object.contains("optional") && !std::filesystem::exists(file, error)) {
      missing = "/label_map/file: the optional data " + file.lexically_normal().string() +
                " are not here, so this scenario is left out; " + object["optional"].get<std::string>();
    } else {
      collect(problems, "/label_map/file", [&] {
        for (const auto& input : label_map_files(file)) scenario.input_files.push_back(input);
      });
    }
  } else {
    scenario.map_source = read_generated(object["generate"]);
  }
  std::size_t number = 0;
  for (const json& operation : object.value("operations", json::array())) {
    const std::string pointer = "/label_map/operations/" + std::to_string(number++);
    if (operation.contains("relabel")) {
      RelabelOperation relabel;
      read(operation["relabel"], "from", relabel.from);
      read(operation["relabel"], "to", relabel.to);
      scenario.map_operations.emplace_back(relabel);
    } else if (operation.contains("keep_labels")) {
      scenario.map_operations.emplace_back(
          KeepLabelsOperation{operation["keep_labels"].get<std::vector<std::int32_t>>()});
    } else if (operation.contains("paint_box_mm")) {
      const json& paint = operation["paint_box_mm"];
      PaintBoxOperation box;
      read_mm(paint, "min", box.min_m);
      read_mm(paint, "max", box.max_m);
      read(paint, "label", box.label);
      check_box(box.min_m, box.max_m, pointer + "/paint_box_mm", problems);
      scenario.map_operations.emplace_back(box);
    } else if (operation.contains("speckle")) {
      SpeckleOperation speckle;
      read(operation["speckle"], "share", speckle.share);
      read(operation["speckle"], "to", speckle.to);
      read(operation["speckle"], "seed", speckle.seed);
      scenario.map_operations.emplace_back(speckle);
    } else if (operation.contains("fill_voids")) {
      scenario.map_operations.emplace_back(FillVoidsOperation{});
    } else if (operation.contains("drop_pieces_below")) {
      DropPiecesOperation drop;
      read(operation["drop_pieces_below"], "voxels", drop.below_voxels);
      read(operation["drop_pieces_below"], "mm3", drop.below_m3);
      drop.below_m3 *= 1e-9;
      scenario.map_operations.emplace_back(drop);
    } else if (operation.contains("crop_to_content")) {
      CropOperation crop;
      read(operation["crop_to_content"], "margin_voxels", crop.margin_voxels);
      scenario.map_operations.emplace_back(crop);
    } else if (operation.contains("layer_between_pairs")) {
      LayerOperation layer;
      read(operation["layer_between_pairs"], "label", layer.label);
      read(operation["layer_between_pairs"], "voxels", layer.voxels);
      scenario.map_operations.emplace_back(layer);
    } else {
      KeepBoxOperation box;
      read_mm(operation["keep_box_mm"], "min", box.min_m);
      read_mm(operation["keep_box_mm"], "max", box.max_m);
      check_box(box.min_m, box.max_m, pointer + "/keep_box_mm", problems);
      scenario.map_operations.emplace_back(box);
    }
  }
}

}  // namespace sulcus
