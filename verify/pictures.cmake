# Pictures without a display (OSMesa, FreeType), PNG files, charts (gnuplot at run time) and the report.
find_package(PNG REQUIRED)
find_package(Freetype REQUIRED)
find_path(OSMESA_INCLUDE_DIR GL/osmesa.h REQUIRED)
find_library(OSMESA_LIBRARY OSMesa REQUIRED)
find_path(SULCUS_FONT_DIR DejaVuSans.ttf PATHS /usr/share/fonts PATH_SUFFIXES truetype/dejavu dejavu TTF REQUIRED)

sulcus_library(sulcus_pictures
  colour_map.cpp gnuplot.cpp performance.cpp picture.cpp picture_diff.cpp picture_gl.cpp picture_occlusion.cpp picture_shapes.cpp picture_text.cpp
  plots.cpp png.cpp report.cpp report_charts.cpp report_session.cpp report_steps.cpp report_template.cpp report_values.cpp
  run_picture.cpp section.cpp suite_index.cpp work_precision.cpp
  LINK sulcus_verify sulcus_numerics)
target_link_libraries(sulcus_pictures PRIVATE nlohmann_json::nlohmann_json PNG::PNG Freetype::Freetype ${OSMESA_LIBRARY})
target_include_directories(sulcus_pictures SYSTEM PRIVATE ${OSMESA_INCLUDE_DIR})
target_compile_definitions(sulcus_pictures PRIVATE SULCUS_FONT_DIR="${SULCUS_FONT_DIR}")

sulcus_test(pictures_test
  performance_test.cpp picture_diff_test.cpp picture_test.cpp plots_test.cpp png_test.cpp report_session_test.cpp report_test.cpp
  run_picture_test.cpp section_test.cpp suite_index_test.cpp work_precision_test.cpp test_run.cpp
  LINK sulcus_pictures)
