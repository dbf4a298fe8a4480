use super::*;
use avln_arena::FailureKind;
use avln_geom::{Point3, RayMesh, Rng, UnitQuaternion, Vector3, angle};
use avln_houses::house;
use avln_lab::npy;
use clap::Parser;
use serde_json::json;
use std::fs;
use tempfile::TempDir;

#[derive(Parser)]
struct Program {
    #[command(flatten)]
    options: RenderArgs,
}

fn called(words: &[&str]) -> Result<RenderArgs, clap::Error> {
    Program::try_parse_from([&["render"], words].concat()).map(|program| program.options)
}

fn render(words: &[&str]) -> Result<(), Failure> {
    render_with(Path::new("no data folder"), words)
}

fn render_with(data: &Path, words: &[&str]) -> Result<(), Failure> {
    run(data, &called(words).unwrap_or_else(|error| panic!("{error}")))
}

fn folder() -> (TempDir, impl Fn(&str) -> String) {
    let folder = tempfile::tempdir().expect("a folder for temporary files");
    let path = folder.path().to_owned();
    (folder, move |name: &str| path.join(name).to_str().expect("Unicode").to_owned())
}

/// Returns width, height and bytes from an RGB picture.
fn png(path: &str) -> (u32, u32, Vec<u8>) {
    let decoder = png::Decoder::new(std::io::BufReader::new(fs::File::open(path).expect("a file")));
    let mut reader = decoder.read_info().expect("a header");
    let mut bytes = vec![0; reader.output_buffer_size().expect("a size")];
    let info = reader.next_frame(&mut bytes).expect("a picture");
    assert_eq!((info.color_type, info.bit_depth), (png::ColorType::Rgb, png::BitDepth::Eight));
    (info.width, info.height, bytes)
}

fn depths(path: &str) -> ([usize; 2], Vec<f32>) {
    let (kind, shape, numbers) = npy::read(&fs::read(path).expect("a file")).expect("an array");
    assert_eq!(kind, "<f4");
    (shape, numbers.into_iter().map(f32::from_le_bytes).collect())
}

fn ids(path: &str) -> Vec<u32> {
    let (kind, _, numbers) = npy::read(&fs::read(path).expect("a file")).expect("an array");
    assert_eq!(kind, "<u4");
    numbers.into_iter().map(u32::from_le_bytes).collect()
}

#[test]
fn data_folder_caches_model_without_changing_files() {
    let (folder, at) = folder();
    let take = |data: &Path, name: &str| {
        let pose = ["--seed", "4", "--pose", "1.5,1.25,-2,130,-20", "--size", "40x30", "--out"];
        render_with(data, &[&pose[..], &[&at(name)]].concat()).expect("a picture");
        fs::read(at(name)).expect("a file")
    };
    let plain = take(Path::new("no data folder"), "plain.png");
    let kept = || fs::read_dir(folder.path().join(CacheFolder::IN_DATA)).map_or(0, Iterator::count);
    assert_eq!((take(folder.path(), "kept.png") == plain, kept()), (true, 1));
    assert_eq!((take(folder.path(), "found.png") == plain, kept()), (true, 1));
}

#[test]
fn single_and_batch_renders_are_equal() {
    let (_folder, at) = folder();
    let (rgb, depth, numbers) = (at("rgb.png"), at("depth.npy"), at("ids.npy"));
    let pose = ["--seed", "4", "--pose", "1.5,1.25,-2,130,-20"];
    let lens = ["--size", "40x30", "--hfov", "75", "--max-depth", "2"];
    render(&[&pose[..], &lens, &["--out", &rgb, "--depth", &depth, "--ids", &numbers]].concat())
        .expect("a picture");
    let pose: CameraPose = pose[3].parse().expect("a pose");
    let rotation = <[f32; 4]>::from(pose.world_from_camera.coords);
    let other =
        json!({"position": [0.0, 1.0, 0.0], "rotation": [0.3, 0.1, -0.2, 0.5], "width": 9, "height": 5});
    let wanted = json!([other, {
        "position": [1.5, 1.25, -2], "rotation": rotation, "hfov_deg": 75, "width": 40, "height": 30
    }]);
    fs::write(at("poses.json"), wanted.to_string()).expect("a file");
    for threads in ["1", "2", "8"] {
        let into = at(&format!("made/out-{threads}"));
        render(&[
            "--seed",
            "4",
            "--poses",
            &at("poses.json"),
            "--out-dir",
            &into,
            "--max-depth",
            "2",
            "--threads",
            threads,
        ])
        .expect("pictures");
        for (number, one) in [("rgb.png", &rgb), ("depth.npy", &depth), ("ids.npy", &numbers)] {
            let many = fs::read(format!("{into}/001.{number}")).expect("a file");
            assert_eq!(many, fs::read(one).expect("a file"), "{number}");
            let first =
                |threads: &str| fs::read(at(&format!("made/out-{threads}/000.{number}"))).expect("a file");
            assert_eq!(first(threads), first("1"), "{number}");
        }
        assert_eq!(fs::read_dir(&into).expect("a folder").count(), 6);
    }
    let (width, height, colors) = png(&rgb);
    assert_eq!((width, height, colors.len()), (40, 30, 3600));
    let (shape, depths) = depths(&depth);
    assert_eq!(shape, [30, 40]);
    assert!(depths.iter().all(|depth| (0.0..=2.0).contains(depth)) && depths.contains(&0.0));
}

#[test]
fn images_agree_with_rays_in_any_direction() {
    let (_folder, at) = folder();
    let scene = house("house-4", 4, &Default::default());
    let rays = RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles);
    let mut rng = Rng::new(5);
    let mut draw = |room: usize| {
        let middle = scene.regions[room % scene.regions.len()].bounds.center();
        let turns = [rng.range(-3.0, 3.0), rng.range(-1.5, 1.5), rng.range(-3.0, 3.0)];
        (middle, held(turns))
    };
    let poses: Vec<(Point3<f32>, UnitQuaternion<f32>)> = (0..12).map(&mut draw).collect();
    let entry = |(eye, rotation): &(Point3<f32>, UnitQuaternion<f32>)| {
        let rotation = <[f32; 4]>::from(rotation.coords).map(|value| value * 3.0);
        json!({"position": [eye.x, eye.y, eye.z], "rotation": rotation, "width": 31, "height": 23, "hfov_deg": 90})
    };
    let entries: Vec<Value> = poses.iter().map(entry).collect();
    fs::write(at("poses.json"), json!(entries).to_string()).expect("a file");
    render(&["--seed", "4", "--poses", &at("poses.json"), "--out-dir", &at("out")]).expect("pictures");
    let (mut compared, mut different) = (0, 0);
    for (index, (eye, rotation)) in poses.iter().enumerate() {
        let (_, depths) = depths(&at(&format!("out/{index:03}.depth.npy")));
        let ids = ids(&at(&format!("out/{index:03}.ids.npy")));
        for pixel in 0..31 * 23 {
            let (x, y) = ((pixel % 31) as f32 + 0.5 - 15.5, (pixel / 31) as f32 + 0.5 - 11.5);
            let direction = rotation * Vector3::new(x / 15.5, -y / 15.5, -1.0);
            let hit = rays.cast(eye, &direction, 1000.0);
            let (depth, id) =
                hit.map_or((0.0, 0), |hit| (hit.distance, scene.mesh.instance_of[hit.triangle as usize].0));
            compared += 1;
            let same = (depths[pixel] - depth).abs() <= 1e-3 * depth.max(0.1) && ids[pixel] == id;
            different += usize::from(!same);
        }
    }
    assert!(different * 200 <= compared, "{different} of {compared} pixels are not what their rays meet");
}

/// Returns a camera that is turned left, tipped up and rolled, radians.
fn held([heading, pitch, roll]: [f32; 3]) -> UnitQuaternion<f32> {
    let (sin, cos) = angle::sin_cos(0.5 * roll);
    let roll = angle::rotation([0.0, 0.0, sin.into(), cos.into()]).expect("a rotation");
    angle::about_up(heading) * angle::about_right(pitch) * roll
}

#[test]
fn depth_has_no_limit_unless_one_is_given() {
    let (_folder, at) = folder();
    let far = |limit: &[&str]| {
        // From high above, the house is far below.
        let call = ["--seed", "4", "--pose", "0,500,0,0,-90", "--size", "8x8", "--hfov", "2", "--depth"];
        render(&[&call[..], &[&at("depth.npy")], limit].concat()).expect("a picture");
        depths(&at("depth.npy")).1
    };
    assert!(far(&[]).iter().any(|depth| (490.0..500.5).contains(depth)));
    assert!(far(&["--max-depth", "400"]).iter().all(|depth| *depth == 0.0));
}

#[test]
fn noise_depends_on_seed_and_keeps_instances() {
    let (_folder, at) = folder();
    let room = house("house-4", 4, &Default::default()).regions[0].bounds.center();
    let pose = format!("{},1.2,{},40,-10", room.x, room.z);
    let take = |name: &str, noise: &[&str]| {
        let (rgb, depth, numbers) = (at(&format!("{name}.png")), at(&format!("{name}.npy")), at("ids.npy"));
        let call = ["--seed", "4", "--pose", &pose, "--size", "48x48"];
        render(&[&call[..], &["--out", &rgb, "--depth", &depth, "--ids", &numbers], noise].concat())
            .expect("a picture");
        (png(&rgb).2, depths(&depth).1, ids(&numbers))
    };
    let clean = take("clean", &[]);
    let both = ["--depth-noise", "redwood", "--rgb-noise", "gaussian", "--noise-seed", "5"];
    let noisy = take("noisy", &both);
    assert_eq!(noisy, take("again", &both));
    assert_eq!(clean.2, noisy.2);
    assert!(clean.0 != noisy.0 && clean.1 != noisy.1);
    assert_ne!(noisy, take("other", &[&both[..5], &["6"]].concat()));
    let depth_alone = take("depth", &["--depth-noise", "redwood", "--noise-seed", "5"]);
    assert_eq!((depth_alone.0, depth_alone.1), (clean.0, noisy.1));
    for bad in [["--depth-noise", "gaussian"], ["--rgb-noise", "loud"], ["--noise-seed", "-1"]] {
        assert!(called(&[&["--seed", "4", "--pose", &pose, "--ids", "i.npy"][..], &bad].concat()).is_err());
    }
}

#[test]
fn bad_pose_error_has_index_and_field() {
    let (_folder, at) = folder();
    let good = json!({"position": [0, 1, 0], "rotation": [0, 0, 0, 1]});
    for (field, value) in [
        ("rotation", json!([0, 0, 0, 0])),
        ("fov", json!(90)),
        ("position", json!(null)),
        ("width", json!(5000)),
    ] {
        let mut bad = good.clone();
        bad[field] = value;
        fs::write(at("poses.json"), json!([good, good, bad]).to_string()).expect("a file");
        let call = ["--seed", "4", "--poses", &at("poses.json"), "--out-dir", &at("out")];
        let failure = render(&call).expect_err("a bad pose");
        let text = failure.to_string();
        assert!(text.contains("pose 2") && text.contains(field), "{text}");
        assert_eq!(failure.kind(), FailureKind::Data);
        assert!(!Path::new(&at("out")).exists());
    }
    for text in ["", "{}", "[1e999]"] {
        fs::write(at("poses.json"), text).expect("a file");
        let call = ["--seed", "4", "--poses", &at("poses.json"), "--out-dir", &at("out")];
        assert_eq!(render(&call).expect_err("no poses").kind(), FailureKind::Data, "{text}");
    }
}

#[test]
fn unwritable_files_and_missing_scenes_are_named() {
    let (_folder, at) = folder();
    fs::write(at("file"), "a file").expect("a file");
    let nowhere = at("none/rgb.png");
    let failure = render(&["--seed", "4", "--pose", "0,1,0,0", "--size", "4x4", "--out", &nowhere])
        .expect_err("no folder");
    assert!(failure.to_string().contains("none/rgb.png"), "{failure}");
    fs::write(at("poses.json"), json!([{"position": [0, 1, 0], "rotation": [0, 0, 0, 1]}]).to_string())
        .expect("a file");
    let into_a_file = ["--seed", "4", "--poses", &at("poses.json"), "--out-dir", &at("file")];
    assert_eq!(render(&into_a_file).expect_err("a file").kind(), FailureKind::Data);
    let absent = ["--scene", &at("none.glb"), "--pose", "0,1,0,0", "--out", &at("rgb.png")];
    assert_eq!(render(&absent).expect_err("no scene").kind(), FailureKind::Scene);
}

#[test]
fn incomplete_and_excessive_calls_are_rejected() {
    let pose = ["--seed", "1", "--pose", "-1,2,3,4,5"];
    let with = |more: &[&str]| called(&[&pose[..], more].concat());
    assert!(with(&["--out", "a.png"]).is_ok() && with(&["--ids", "i.npy", "--depth", "d.npy"]).is_ok());
    for more in [
        &[][..],
        &["--out", "a.png", "--out-dir", "b"],
        &["--out", "a.png", "--poses", "p.json", "--out-dir", "b"],
        &["--out", "a.png", "--threads", "2"],
        &["--out", "a.png", "--size", "0x5"],
        &["--out", "a.png", "--hfov", "180"],
        &["--out", "a.png", "--max-depth", "0"],
    ] {
        assert!(with(more).is_err(), "{more:?}");
    }
    let many = ["--seed", "1", "--poses", "p.json", "--out-dir", "b"];
    assert!(called(&many).is_ok() && called(&many[..4]).is_err() && called(&many[..2]).is_err());
    for more in [["--threads", "0"], ["--size", "9x9"], ["--hfov", "60"], ["--depth", "d.npy"]] {
        assert!(called(&[&many[..], &more].concat()).is_err(), "{more:?}");
    }
}

#[test]
fn image_numbers_have_at_least_three_digits() {
    let (_folder, at) = folder();
    let pose = json!({"position": [0, 1, 0], "rotation": [0, 0, 0, 1], "width": 1, "height": 1});
    for (count, last, digits) in [(1000, 999, 3), (1001, 1000, 4)] {
        fs::write(at("poses.json"), json!(vec![&pose; count]).to_string()).expect("a file");
        let options =
            called(&["--seed", "4", "--poses", &at("poses.json"), "--out-dir", "out"]).expect("options");
        let shots = options.shots().expect("pictures");
        let name = |index: usize| shots[index].files.ids.clone().expect("a file");
        assert_eq!(name(0), Path::new("out").join(format!("{:0digits$}.ids.npy", 0)));
        assert_eq!(name(last), Path::new("out").join(format!("{last}.ids.npy")));
    }
    fs::write(at("poses.json"), "[]").expect("a file");
    render(&["--seed", "4", "--poses", &at("poses.json"), "--out-dir", &at("none")]).expect("no pictures");
    assert_eq!(fs::read_dir(at("none")).expect("a folder").count(), 0);
}

#[test]
fn pose_requires_position_and_rotation() {
    let entry = json!({"position": [1, 2.5, -3], "rotation": [0, 2, 0, 2]});
    let wanted = PoseEntry::from_json(&entry).expect("a pose");
    assert_eq!((wanted.size.width, wanted.size.height, wanted.hfov.degrees), (256, 256, 90.0));
    let spoken: CameraPose = "1,2.5,-3,90".parse().expect("a pose");
    assert_eq!(wanted.pose.eye, spoken.eye);
    let ahead = |pose: &CameraPose| pose.world_from_camera * -Vector3::z();
    assert!((ahead(&wanted.pose) - ahead(&spoken)).norm() < 1e-6);
    let entry =
        json!({"position": [0, 0, 0], "rotation": [0, 0, 0, 1], "hfov_deg": 60, "width": 7, "height": 9});
    let wanted = PoseEntry::from_json(&entry).expect("a pose");
    assert_eq!((wanted.size.width, wanted.size.height, wanted.hfov.degrees), (7, 9, 60.0));
}

#[test]
fn invalid_pose_error_names_field() {
    let good = json!({"position": [0, 0, 0], "rotation": [0, 0, 0, 1]});
    assert!(PoseEntry::from_json(&good).is_ok());
    for (field, value) in [
        ("position", json!([0, 0])),
        ("position", json!([0, 0, "x"])),
        ("position", json!([0, 0, 1e7])),
        ("rotation", json!([0, 0, 0, 0])),
        ("rotation", json!([0, 0, 0])),
        ("hfov_deg", json!("wide")),
        ("hfov", json!(90)),
        ("width", json!(0)),
        ("width", json!(-1)),
        ("height", json!(4097)),
        ("height", json!(1.5)),
        ("pitch", json!(0)),
    ] {
        let mut bad = good.clone();
        bad[field] = value.clone();
        let refused = PoseEntry::from_json(&bad).expect_err("a bad field");
        assert!(refused.contains(field), "{field} {value}: {refused}");
    }
    for (missing, entry) in
        [("position", json!({"rotation": [0, 0, 0, 1]})), ("rotation", json!({"position": [0, 0, 0]}))]
    {
        assert!(PoseEntry::from_json(&entry).is_err_and(|refused| refused.contains(missing)));
    }
    for hfov_deg in [0.0, 180.0, -5.0] {
        let mut bad = good.clone();
        bad["hfov_deg"] = json!(hfov_deg);
        assert!(PoseEntry::from_json(&bad).is_err_and(|refused| refused.contains("hfov")), "{hfov_deg}");
    }
    assert!(PoseEntry::from_json(&json!([1, 2])).is_err());
}

fn ahead(words: &str) -> Vector3<f32> {
    let pose: CameraPose = words.parse().expect("a pose");
    pose.world_from_camera * -Vector3::z()
}

#[test]
fn headings_turn_left_and_pitches_look_up() {
    let half = std::f32::consts::FRAC_1_SQRT_2;
    for (words, [x, y, z]) in [
        ("1,2,3,0", [0.0, 0.0, -1.0]),
        ("1,2,3,90", [-1.0, 0.0, 0.0]),
        (" -1, 2,3 ,-90", [1.0, 0.0, 0.0]),
        ("1,2,3,0,45", [0.0, half, -half]),
        ("1,2,3,180,-45", [0.0, -half, half]),
        ("1,2,3,77,-90", [0.0, -1.0, 0.0]),
    ] {
        assert!((ahead(words) - Vector3::new(x, y, z)).norm() < 1e-6, "{words}: {:?}", ahead(words));
    }
    let pose: CameraPose = "-1,2.5,3,10,20".parse().expect("a pose");
    assert_eq!(pose.eye, Point3::new(-1.0, 2.5, 3.0));
    assert!((pose.world_from_camera * Vector3::x()).y.abs() < 1e-7, "the horizon is level");
}

#[test]
fn poses_sizes_and_angles_without_sense_are_refused() {
    for bad in
        ["", "1,2,3", "1,2,3,4,5,6", "1,2,three,4", "1,2,3,NaN", "1,2,3,4,inf", "1e7,0,0,0", "nan,0,0,0"]
    {
        assert!(bad.parse::<CameraPose>().is_err(), "{bad}");
    }
    for bad in ["", "256", "0x1", "1x0", "4097x2", "2x4097", "-1x2", "1.5x2", "axb", "1x2x3"] {
        assert!(bad.parse::<PictureSize>().is_err(), "{bad}");
    }
    for bad in ["", "0", "0.1", "179.9", "180", "-90", "NaN", "inf", "wide"] {
        assert!(bad.parse::<Hfov>().is_err(), "{bad}");
    }
    for bad in ["", "0", "-1", "NaN", "inf", "far"] {
        assert!(bad.parse::<MaxDepth>().is_err(), "{bad}");
    }
    assert_eq!("4096x1".parse(), Ok(PictureSize { width: 4096, height: 1 }));
    assert_eq!("0.2".parse(), Ok(Hfov { degrees: 0.2 }));
}
