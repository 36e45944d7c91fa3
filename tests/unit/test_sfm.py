"""The mapper on points of known scenes: what it accepts is right, what is wrong it refuses."""

import dataclasses
import shutil
from collections.abc import Callable

import numpy as np
import pytest

from mvmatch.errors import DataError
from mvmatch.export.colmap import write_database
from mvmatch.export.verification import VerificationOptions
from mvmatch.geometry.trajectory import trajectory_error
from mvmatch.sfm import AcceptanceOptions, MapperOptions, reconstruct
from mvmatch.sfm.adjust import adjust, adjust_unknown_camera, fit_squares
from mvmatch.sfm.breaks import hopeless
from mvmatch.sfm.checks import Boundary, check_model, contradicted_boundary, weakest_joint
from mvmatch.sfm.evidence import _selection, read_evidence
from mvmatch.sfm.focal import FACTORS, estimate_focal, thinned
from mvmatch.types import Tracks

pycolmap = pytest.importorskip("pycolmap")

FOCAL = 500.0
FRAMES = 10


def camera(focal: float = FOCAL):
    made = pycolmap.Camera(model="PINHOLE", width=640, height=480, params=[focal, focal, 320, 240])
    made.has_prior_focal_length = True
    return made


def observe(centers, *, noise=0.2, angles=None, seed=0, movers=None) -> Tracks:
    """Tracks of points in a corridor around the path, seen from centers looking along z."""
    generator = np.random.default_rng(seed)
    count = 300
    points = generator.uniform([-6, -4, 3], [6, 4, 25], (count, 3))
    rows: list[list[tuple[int, float, float]]] = [[] for _ in range(count)]
    for frame, center in enumerate(centers):
        angle = 0.0 if angles is None else angles[frame]
        c, s = np.cos(angle), np.sin(angle)
        world = points if movers is None else points + movers * frame
        seen = (world - center) @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]).T
        xy = seen[:, :2] / seen[:, 2:] * FOCAL + [320, 240]
        xy += generator.normal(scale=noise, size=xy.shape)
        inside = (seen[:, 2] > 0.5) & (xy > 0).all(axis=1) & (xy < [640, 480]).all(axis=1)
        for index in np.flatnonzero(inside):
            rows[index].append((frame, *xy[index]))
    return Tracks.from_lists(*(row for row in rows if len(row) >= 3))


def database(tmp_path, tracks, **options):
    path = tmp_path / "database.db"
    names = [f"{frame:06d}.png" for frame in range(FRAMES)]
    write_database(tracks, path, camera=options.get("camera", camera()), image_names=names)
    return path


FORWARD = np.array([[0.02 * np.sin(f), 0, 0.4 * f] for f in range(FRAMES)])


@pytest.fixture(scope="module")
def forward(tmp_path_factory):
    """Database of a drive straight ahead, and what became of it."""
    folder = tmp_path_factory.mktemp("forward")
    path = database(folder, observe(FORWARD))
    before = path.read_bytes()
    result = reconstruct(path, folder / "sfm")
    assert path.read_bytes() == before, "the database is only read"
    return path, result


def test_a_forward_drive_is_registered_in_full_and_its_path_is_right(forward):
    path, result = forward

    assert result.accepted
    assert result.reasons == ()
    assert (result.registered, result.total) == (FRAMES, FRAMES)
    assert result.mean_reprojection_error < 0.4
    model = pycolmap.Reconstruction(result.path)
    assert result.path == path.parent / "sfm" / "0"
    centers = [model.image(index + 1).projection_center() for index in range(FRAMES)]
    assert trajectory_error(centers, FORWARD).percent_of_path < 0.3


def test_the_same_database_gives_the_same_model_again(forward, tmp_path):
    path, first = forward
    second = reconstruct(path, tmp_path)

    for image in first.reconstruction.images.values():
        other = second.reconstruction.image(image.image_id)
        np.testing.assert_array_equal(
            image.cam_from_world().matrix(), other.cam_from_world().matrix()
        )


def test_the_global_mapper_gives_the_same_path(forward, tmp_path):
    path, _ = forward
    result = reconstruct(path, tmp_path / "sfm", options=MapperOptions(mapper="global"))

    assert result.accepted
    assert result.attempts[0].mapper == "global"
    model = result.reconstruction
    centers = [model.image(index + 1).projection_center() for index in range(FRAMES)]
    assert trajectory_error(centers, FORWARD).percent_of_path < 0.5


def test_a_given_camera_is_kept_to_the_letter_when_the_model_agrees(tmp_path):
    sideways = np.array([[0.3 * f, 0, 0] for f in range(FRAMES)])
    tracks = observe(sideways, angles=np.linspace(0, 0.3, FRAMES))
    result = reconstruct(database(tmp_path, tracks), tmp_path / "sfm")

    assert result.accepted
    assert result.reconstruction.camera(1).params.tolist() == [FOCAL, FOCAL, 320, 240]


def test_a_focal_length_that_is_two_percent_off_is_corrected_unless_it_is_fixed(tmp_path):
    sideways = np.array([[0.3 * f, 0, 0] for f in range(FRAMES)])
    tracks = observe(sideways, angles=np.linspace(0, 0.3, FRAMES))
    path = database(tmp_path, tracks, camera=camera(1.02 * FOCAL))

    corrected = reconstruct(path, tmp_path / "a").reconstruction.camera(1)
    fixed = reconstruct(
        path, tmp_path / "b", options=MapperOptions(intrinsics="fixed")
    ).reconstruction.camera(1)
    assert corrected.model_name == "PINHOLE"
    assert corrected.focal_length_x == pytest.approx(FOCAL, rel=0.008)
    assert fixed.focal_length_x == 1.02 * FOCAL


@pytest.mark.parametrize(("factor", "is_kept"), [(1.008, True), (1.02, False)])
def test_a_calibration_is_trusted_to_one_percent_however_much_the_model_insists(
    tmp_path, factor, is_kept
):
    sideways = np.array([[0.3 * f, 0, 0] for f in range(FRAMES)])
    tracks = observe(sideways, noise=0.02, angles=np.linspace(0, 0.3, FRAMES))
    path = database(tmp_path, tracks, camera=camera(factor * FOCAL))

    options = MapperOptions(min_focal_error=0.0)
    used = reconstruct(path, tmp_path / "sfm", options=options).reconstruction.camera(1)

    assert (used.focal_length_x == factor * FOCAL) is is_kept


def test_a_model_whose_focal_length_was_corrected_is_checked_with_the_corrected_one(tmp_path):
    sideways = np.array([[0.3 * f, 0, 0] for f in range(FRAMES)])
    tracks = observe(sideways, angles=np.linspace(0, 0.3, FRAMES))
    path = database(tmp_path, tracks, camera=camera(1.04 * FOCAL))
    # Pairs measured with the wrong focal length are 0.4 degrees off, with the corrected one 0.02.
    strict = AcceptanceOptions(max_rotation_error=0.1, max_direction_error=0.5, max_misfit=0)
    result = reconstruct(path, tmp_path / "sfm", options=MapperOptions(acceptance=strict))

    assert result.accepted
    assert len(result.attempts) == 1
    old = check_model(result.reconstruction, read_evidence(path), strict)
    assert any("contradicts" in reason for reason in old.reasons)


def test_a_point_that_slipped_behind_the_cameras_is_left_out(forward):
    _, result = forward
    model = pycolmap.Reconstruction(result.reconstruction)
    lost = min(model.point3D_ids())
    model.point3D(lost).xyz = model.image(1).projection_center() - np.array([0, 0, 0.01])
    adjust(model, MapperOptions())

    assert not model.exists_point3D(lost)
    assert model.num_points3D() == result.num_points - 1
    assert model.compute_mean_reprojection_error() < 0.4


def test_a_guessed_focal_length_is_refined(tmp_path):
    sideways = np.array([[0.3 * f, 0, 0] for f in range(FRAMES)])
    tracks = observe(sideways, angles=np.linspace(0, 0.3, FRAMES))
    prior = pycolmap.Camera(
        model="SIMPLE_RADIAL", width=640, height=480, params=[1.3 * FOCAL, 320, 240, 0]
    )
    prior.has_prior_focal_length = False
    options = MapperOptions(max_attempts=1, fallback=False)
    path = database(tmp_path, tracks, camera=prior)
    result = reconstruct(path, tmp_path / "sfm", options=options)

    assert result.registered == FRAMES
    assert result.reconstruction.camera(1).focal_length == pytest.approx(FOCAL, rel=0.02)


def seen_through_a_lens(model, distortion):
    """A model whose pictures were taken with distortion, and whose camera has none."""
    model = pycolmap.Reconstruction(model)
    prior = model.camera(1)
    prior.model = pycolmap.CameraModelId.SIMPLE_RADIAL
    prior.params = [FOCAL, 320, 240, 0]
    lens = pycolmap.Camera(
        model="SIMPLE_RADIAL", width=640, height=480, params=[FOCAL, 320, 240, distortion]
    )
    for image in model.images.values():
        for point in image.points2D:
            point.xy = lens.img_from_cam(np.append(prior.cam_from_img(point.xy), 1.0))
    return model


@pytest.mark.parametrize("distortion", [0.0, -0.3])
def test_distortion_is_refined_where_the_lens_has_it_and_nowhere_else(forward, distortion):
    model = seen_through_a_lens(forward[1].reconstruction, distortion)

    refined = adjust_unknown_camera(model, MapperOptions()).camera(1)

    assert refined.params[3] == pytest.approx(distortion, rel=0.1, abs=0.0)
    assert refined.focal_length == pytest.approx(FOCAL, rel=0.03)


def test_a_camera_far_from_the_true_one_is_refined_to_the_end(tmp_path):
    path = np.array([[0.3 * np.sin(f / 3), 0, 0.4 * f] for f in range(FRAMES)])
    tracks = observe(path, angles=np.linspace(0, 0.3, FRAMES))
    model = reconstruct(database(tmp_path, tracks), tmp_path / "sfm").reconstruction
    model = seen_through_a_lens(model, -0.3)
    model.camera(1).focal_length = 2 * FOCAL
    once = pycolmap.Reconstruction(model)
    fit_squares(once, "focal length")
    fit_squares(once, "intrinsics")

    refined = adjust_unknown_camera(model, MapperOptions()).camera(1)

    assert once.camera(1).focal_length > 1.1 * FOCAL, "one fit ends half-way"
    assert refined.focal_length == pytest.approx(FOCAL, rel=0.01)


def test_a_camera_that_stands_still_gives_no_model_and_says_why(tmp_path):
    tracks = observe(np.zeros((FRAMES, 3)), noise=0.1)
    result = reconstruct(database(tmp_path, tracks), tmp_path / "sfm")

    assert not result.accepted
    assert result.path is None
    assert "does not move" in result.reasons[0]
    assert not (tmp_path / "sfm").exists()


def test_a_camera_that_only_turns_gives_no_model_and_says_why(tmp_path):
    tracks = observe(np.zeros((FRAMES, 3)), angles=np.linspace(0, 0.25, FRAMES))
    result = reconstruct(database(tmp_path, tracks), tmp_path / "sfm")

    assert not result.accepted
    assert "only turns" in result.reasons[0]


@pytest.fixture(scope="module")
def turning(tmp_path_factory):
    """Evidence of a camera that only turns."""
    tracks = observe(np.zeros((FRAMES, 3)), angles=np.linspace(0, 0.25, FRAMES))
    return read_evidence(database(tmp_path_factory.mktemp("turning"), tracks))


def with_motion(evidence, chosen):
    """Evidence in which some pairs fit no rotation any more."""
    pairs = [
        dataclasses.replace(pair, stretch=0.2) if chosen(pair) else pair for pair in evidence.pairs
    ]
    return dataclasses.replace(evidence, pairs=tuple(pairs))


def test_a_wrong_pair_anywhere_does_not_make_a_turn_a_motion(turning):
    assert len(turning.pairs) > 10
    for wrong in turning.pairs:
        assert "only turns" in str(hopeless(with_motion(turning, lambda pair, w=wrong: pair is w)))


def test_a_part_in_which_the_camera_moves_is_worth_a_try(turning):
    many = dataclasses.replace(
        turning,
        pairs=tuple(
            dataclasses.replace(pair, image0=pair.image0 + shift, image1=pair.image1 + shift)
            for shift in range(0, 20 * FRAMES, FRAMES)
            for pair in turning.pairs
        ),
    )
    part = with_motion(many, lambda pair: pair.image1 <= FRAMES)
    moving = [pair.stretch > 0.1 for pair in part.pairs]
    assert np.mean(moving) < 0.1
    assert hopeless(many) is not None
    assert hopeless(part) is None


def test_slow_motion_that_only_far_pairs_see_is_worth_a_try(turning):
    pairs = [
        dataclasses.replace(turning.pairs[0], image0=image, image1=image + gap)
        for image in range(1, 31)
        for gap in (2, 5, 10)
    ]
    slow = dataclasses.replace(turning, pairs=tuple(pairs))
    assert hopeless(slow) is not None
    assert hopeless(with_motion(slow, lambda pair: pair.image1 - pair.image0 == 10)) is None


def test_a_bent_model_is_refused_though_all_images_are_registered(forward, tmp_path):
    path, result = forward
    model, evidence = (
        pycolmap.Reconstruction(result.reconstruction),
        read_evidence(shutil.copy(path, tmp_path)),
    )
    assert check_model(model, evidence, AcceptanceOptions()).accepted

    for image_id in model.reg_image_ids():  # bend the path by two degrees per image
        turn = pycolmap.Rotation3d(np.array([0.0, np.radians(2.0 * image_id), 0.0]))
        frame = model.frame(model.image(image_id).frame_id)
        pose = model.image(image_id).cam_from_world()
        frame.set_cam_from_world(1, pycolmap.Rigid3d(turn, np.zeros(3)) * pose)
    check = check_model(model, evidence, AcceptanceOptions())
    assert check.registered == FRAMES
    assert check.agreement < 0.5
    assert any("contradicts" in reason for reason in check.reasons)


def test_a_model_whose_first_images_lie_wrong_is_refused(forward):
    """Most pairs agree with it, and points hold both parts together: the mapper left out others."""
    path, result = forward
    model, evidence = pycolmap.Reconstruction(result.reconstruction), read_evidence(path)
    lenient = AcceptanceOptions(min_agreement=0.0)
    assert contradicted_boundary(model, evidence, lenient) is None

    turn = pycolmap.Rigid3d(pycolmap.Rotation3d(np.array([0.0, 0.1, 0.0])), np.zeros(3))
    for image_id in (1, 2, 3):
        frame = model.frame(model.image(image_id).frame_id)
        frame.set_cam_from_world(1, model.image(image_id).cam_from_world() * turn)
    found = contradicted_boundary(model, evidence, lenient)
    assert found == Boundary(before=3, after=4, across=found.across, against=found.across)
    (reason,) = check_model(model, evidence, lenient).reasons
    assert reason.startswith("the model contradicts ")
    assert reason.endswith(" image pairs across the step from image 3 to 4")


def test_a_model_in_two_halves_is_found_at_its_joint(forward):
    _, result = forward
    model = pycolmap.Reconstruction(result.reconstruction)
    whole, _ = weakest_joint(model)
    for point_id in list(model.point3D_ids()):
        seen = [element.image_id for element in model.point3D(point_id).track.elements]
        if min(seen) <= 6 < max(seen):
            model.delete_point3D(point_id)

    assert whole > 60
    assert weakest_joint(model) == (0, 6)


def test_two_scales_are_suspected_where_no_point_is_seen_twice_on_either_side(forward):
    path, result = forward
    model = pycolmap.Reconstruction(result.reconstruction)
    assert check_model(model, read_evidence(path), AcceptanceOptions()).accepted
    bridging = 0
    for point_id in list(model.point3D_ids()):
        views = {e.image_id: e.point2D_idx for e in model.point3D(point_id).track.elements}
        before, after = (sorted(i for i in views if (i > 5) is side) for side in (False, True))
        if before and after:  # one view is left on either side
            bridging += 1
            for image_id in (*before[:-1], *after[1:]):
                model.delete_observation(image_id, views[image_id])

    assert bridging > 60
    assert weakest_joint(model, views=2)[0] == 0
    reasons = check_model(model, read_evidence(path), AcceptanceOptions()).reasons
    assert any("only 0 points are seen twice before and after" in reason for reason in reasons)


def test_a_model_of_three_images_has_no_cut_that_could_be_seen_twice_over(forward):
    model = pycolmap.Reconstruction(forward[1].reconstruction)
    for frame in range(4, FRAMES + 1):
        model.deregister_frame(frame)
    assert weakest_joint(model, views=2) == (model.num_points3D(), 1)
    assert weakest_joint(pycolmap.Reconstruction(), views=2) == (0, 0)


def test_a_database_without_matches_gives_no_model(tmp_path):
    empty = Tracks.from_lists()
    result = reconstruct(database(tmp_path, empty), tmp_path / "sfm")

    assert not result.accepted
    assert result.total == FRAMES
    assert result.reasons == ("no image pair has enough verified matches",)


def test_a_text_file_is_refused(tmp_path):
    path = tmp_path / "database.db"
    path.write_text("hello")
    with pytest.raises(DataError, match="not a COLMAP database"):
        reconstruct(path, tmp_path / "sfm")


def test_pairs_that_were_judged_by_their_tracks_are_no_evidence_where_others_were_measured(
    tmp_path,
):
    path = tmp_path / "database.db"
    names = [f"{frame:06d}.png" for frame in range(FRAMES)]
    summary = write_database(observe(FORWARD), path, camera=camera(), image_names=names)
    measured = {(score.frame0 + 1, score.frame1 + 1) for score in summary.scores}
    assert len(measured) < summary.num_verified_pairs
    evidence = read_evidence(path)
    assert {(pair.image0, pair.image1) for pair in evidence.pairs} == measured


def test_a_database_without_any_measured_pair_is_measured(tmp_path):
    path = tmp_path / "database.db"
    write_database(
        observe(FORWARD),
        path,
        camera=camera(),
        image_names=[f"{frame:06d}.png" for frame in range(FRAMES)],
        verification=VerificationOptions(mode="trust"),
    )
    assert len(read_evidence(path).pairs) == FRAMES * (FRAMES - 1) // 2


def test_views_from_too_far_aside_are_no_evidence(tmp_path):
    """Nothing looks alike from there: matches of descriptors that agree on it are a pattern's."""
    angles = np.radians(12.0 * np.arange(FRAMES))
    centers = [np.array([0, 0, 14]) - 12 * np.array([np.sin(a), 0, np.cos(a)]) for a in angles]
    evidence = read_evidence(database(tmp_path, observe(centers, angles=angles)))
    gaps = {pair.image1 - pair.image0 for pair in evidence.pairs}
    assert gaps == {1, 2, 3, 4, 5}


def test_a_selection_of_pairs_holds_all_gaps_and_the_whole_sequence():
    pairs = [(frame, frame + gap) for frame in range(400) for gap in range(1, 11)]
    some = _selection(pairs, 400)
    counts = np.bincount([later - frame for frame, later in some])
    assert counts[1:].min() >= 20, "every tenth pair in order would have one gap only"
    assert np.array_equal([frame for frame, _ in some], np.arange(400))
    assert _selection(pairs, 400) == some


def test_a_thinned_sequence_has_a_measured_pair_even_if_its_gap_is_rare(tmp_path):
    path = database(tmp_path, observe(FORWARD))
    evidence = read_evidence(path)
    only = [pair for pair in evidence.pairs if pair.image1 - pair.image0 == 5]
    images, initial = thinned(dataclasses.replace(evidence, pairs=tuple(only)))
    assert initial
    for pair in initial:
        assert pair in only
        assert {pair.image0, pair.image1} <= set(images)


def test_a_focal_length_is_tried_from_other_pairs_where_the_first_is_refused(forward):
    path, result = forward
    evidence = read_evidence(path)
    _, pairs = thinned(evidence)
    asked = []

    def refuse_the_first(focal, images, initial):
        asked.append((focal, initial))
        return None if initial == pairs[0] else pycolmap.Reconstruction(result.reconstruction)

    assert estimate_focal(FOCAL, evidence, refuse_the_first) != FOCAL
    assert len(pairs) > 1
    assert asked[:2] == [(FACTORS[0] * FOCAL, pair) for pair in pairs[:2]]
    assert estimate_focal(FOCAL, evidence, lambda *_: None) == FOCAL


def test_a_focal_length_that_no_lens_has_is_not_believed(forward, monkeypatch):
    def collapse(model, _refine):
        model.camera(1).focal_length = 0.2 * 640
        return 0.0

    model = seen_through_a_lens(forward[1].reconstruction, 0.0)
    monkeypatch.setattr("mvmatch.sfm.adjust.fit_squares", collapse)
    assert adjust_unknown_camera(model, MapperOptions()).camera(1).focal_length == FOCAL


def test_a_model_without_anything_to_adjust_is_adjusted_at_no_cost() -> None:
    model = pycolmap.Reconstruction()
    adjust(model, MapperOptions())
    assert fit_squares(model, "focal length") == 0.0


def test_the_loss_is_as_tight_as_the_points_are_exact(forward) -> None:
    """A tenth of the points with an observation off by 2 px hardly moves the cameras."""
    _, result = forward
    model = pycolmap.Reconstruction(result.reconstruction)
    before = {image: model.image(image).projection_center() for image in model.reg_image_ids()}
    points = [model.point3D(point) for point in sorted(model.point3D_ids())[::10]]
    for point in points:
        element = point.track.elements[0]
        model.image(element.image_id).points2D[element.point2D_idx].xy += np.array([2.0, 0.0])

    def moved(adjusted: Callable[[pycolmap.Reconstruction], object]) -> float:
        changed = pycolmap.Reconstruction(model)
        adjusted(changed)
        return max(
            float(np.linalg.norm(changed.image(image).projection_center() - center))
            for image, center in before.items()
        )

    robust = moved(lambda changed: adjust(changed, MapperOptions()))
    assert robust < 0.5 * moved(lambda changed: fit_squares(changed, "nothing"))
    assert robust < moved(lambda changed: adjust(changed, MapperOptions(loss_scale=0.0)))


def test_both_motions_that_a_plane_leaves_open_fit_its_matches(forward) -> None:
    cv2 = pytest.importorskip("cv2", reason="needs OpenCV to decompose a homography")
    path, _ = forward
    pair = read_evidence(path).pairs[0]
    angle, direction = 0.1, np.array([0.8, 0.0, 0.6])
    rotation = np.array(
        [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    )
    normal = np.array([0.3, 0.1, 0.95]) / np.linalg.norm([0.3, 0.1, 0.95])
    homography = rotation + 0.2 * np.outer(direction, normal)
    xy = np.random.default_rng(0).uniform(-0.5, 0.5, (100, 2))
    moved = np.column_stack([xy, np.ones(100)]) @ homography.T
    plane = dataclasses.replace(pair, normalized=(xy, moved[:, :2] / moved[:, 2:]))

    _, rotations, translations, _ = cv2.decomposeHomographyMat(homography, np.eye(3))
    misfits = [plane.misfit(R, t[:, 0]) for R, t in zip(rotations, translations, strict=True)]
    assert len(misfits) == 4
    assert max(misfits) < 1e-12
    assert plane.misfit(rotation, np.array([0.0, 1.0, 0.0])) > 1e-4


def test_only_a_pair_whose_matches_fit_its_own_motion_better_contradicts_a_model(forward) -> None:
    path, result = forward
    evidence = read_evidence(path)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])

    def agreement(*, with_matches: bool) -> float:
        """Of pairs that measured a camera turned by 90 degrees, with or without their matches."""
        turned = [
            dataclasses.replace(
                pair,
                rotation=turn @ pair.rotation,
                direction=turn @ pair.direction,
                normalized=(
                    pair.normalized[0],
                    pair.normalized[1] @ turn[:2, :2].T if with_matches else pair.normalized[1],
                ),
            )
            for pair in evidence.pairs
        ]
        changed = dataclasses.replace(evidence, pairs=tuple(turned))
        return check_model(result.reconstruction, changed, AcceptanceOptions()).agreement

    assert agreement(with_matches=False) == 1.0
    assert agreement(with_matches=True) == 0.0
