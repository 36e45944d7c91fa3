"""What users call takes a path as text, as PyAV and pycolmap do."""

import inspect

import pytest

import mvmatch
from mvmatch.demo import run_demo
from mvmatch.export import colors, hloc, masks, model, nerfstudio, points, trajectory, undistorted
from mvmatch.export.pictures import write_frames
from mvmatch.pictures import bridge_match, loop_match, refine_match
from mvmatch.refine import gray_pictures
from mvmatch.sfm import write_model, write_models
from mvmatch.store import write_motion
from mvmatch.viz import draw_motion, draw_tracks

pycolmap = pytest.importorskip("pycolmap")

DOORS = [
    *(getattr(mvmatch, name) for name in mvmatch.__all__ if name[0].islower()),
    *(bridge_match, loop_match, refine_match, write_model, write_models, draw_motion, draw_tracks),
    *(colors.color_points, hloc.write_hloc, masks.write_masks, nerfstudio.write_nerfstudio),
    *(model.read_model, model.write_binary, model.write_text, points.write_ply),
    *(trajectory.write_tum, trajectory.write_kitti, trajectory.frame_times),
    *(undistorted.write_undistorted, write_frames, write_motion, gray_pictures, run_demo),
]


@pytest.mark.parametrize("door", DOORS, ids=lambda door: door.__name__)
def test_no_public_function_insists_on_a_path_object(door):
    asked = [str(each.annotation) for each in inspect.signature(door).parameters.values()]
    assert not [kind for kind in asked if kind.startswith("Path")]


def test_text_does_from_the_video_to_the_database(data, tmp_path):
    video = f"{data}/svt_flat_p8.ivf"
    match = refine_match(mvmatch.match_video(video), video)
    camera = mvmatch.parse_camera("150", match.info.width, match.info.height).camera
    names = [f"{frame}.png" for frame in range(match.num_frames)]
    database = f"{tmp_path}/database.db"
    mvmatch.write_database(match.tracks, database, camera=camera, image_names=names)
    assert len(mvmatch.score_database(database)) > 0


def test_text_does_for_a_model_and_what_is_made_of_it(make_model, tmp_path):
    made = make_model()
    model.write_binary(made, f"{tmp_path}/sparse")
    points.write_ply(made, f"{tmp_path}/points.ply")
    nerfstudio.write_nerfstudio(made, f"{tmp_path}/nerfstudio", images=f"{tmp_path}/images")
    assert model.read_model(f"{tmp_path}/sparse").num_reg_images() == made.num_reg_images()


def test_a_camera_file_may_be_named_by_a_path_object(tmp_path):
    camera = tmp_path / "camera.txt"
    camera.write_text("1 SIMPLE_PINHOLE 352 200 300 176 100\n")
    assert mvmatch.parse_camera(camera, 352, 200).camera.params[0] == 300
