use super::places::axes;
use avln_render::{Camera, CameraImage};
use avln_scene::Scene;
use std::fs;
use std::io::Result;
use std::path::Path;

/// Writes raw little-endian arrays and `scene.json`, which lists them with our own frame rate.
pub(crate) fn write(
    folder: &Path,
    scene: &Scene,
    cameras: &[Camera],
    ours: &[CameraImage],
    fps: f64,
) -> Result<()> {
    fs::create_dir_all(folder)?;
    let mesh = &scene.mesh;
    let put = |name: &str, bytes: Vec<u8>| fs::write(folder.join(name), bytes);
    put("positions.f32", floats(mesh.positions.iter().flat_map(|p| [p.x, p.y, p.z])))?;
    put("uvs.f32", floats(mesh.uvs.iter().flat_map(|uv| [uv.x, uv.y])))?;
    put("colors.u8", mesh.colors.concat())?;
    put("triangles.u32", words(mesh.triangles.iter().flatten().copied()))?;
    put("materials.u32", words(mesh.material_of.iter().map(|&material| u32::from(material))))?;
    put("instances.u32", words(mesh.instance_of.iter().map(|id| id.0)))?;
    put("cameras.f32", floats(cameras.iter().flat_map(numbers)))?;
    put("depth.f32", floats(ours.iter().flat_map(|frame| frame.depth.iter().copied())))?;
    put("rgb.u8", ours.iter().flat_map(|frame| frame.rgb.iter().copied()).collect())?;
    put("ids.u32", words(ours.iter().flat_map(|frame| frame.instances.iter().map(|id| id.0))))?;
    for (index, texture) in scene.textures.iter().enumerate() {
        put(&format!("texture-{index}.rgba"), texture.pixels.clone())?;
    }
    put("scene.json", listing(scene, cameras, fps).into_bytes())
}

/// Eye, right, up, ahead, and the tangent of half the angle of view.
fn numbers(camera: &Camera) -> Vec<f32> {
    let [right, up, ahead] = axes(camera);
    let eye = camera.eye.coords;
    let axes = [eye, right, up, ahead].into_iter().flat_map(<[f32; 3]>::from);
    axes.chain([(0.5 * camera.hfov_rad).tan()]).collect()
}

fn listing(scene: &Scene, cameras: &[Camera], fps: f64) -> String {
    let textures = scene.textures.iter().map(|texture| format!("[{}, {}]", texture.width, texture.height));
    let materials = scene.materials.iter().map(|material| {
        let texture = material.texture.map_or("null".to_owned(), |index| index.to_string());
        let cutoff = material.alpha_cutoff.map_or("null".to_owned(), |cutoff| cutoff.to_string());
        format!(r#"{{"color": {:?}, "texture": {texture}, "cutoff": {cutoff}}}"#, material.base_color)
    });
    format!(
        r#"{{"side": {}, "cameras": {}, "ours_fps": {fps}, "textures": [{}], "materials": [{}]}}"#,
        cameras[0].width,
        cameras.len(),
        textures.collect::<Vec<_>>().join(", "),
        materials.collect::<Vec<_>>().join(", ")
    )
}

fn floats(values: impl Iterator<Item = f32>) -> Vec<u8> {
    values.flat_map(f32::to_le_bytes).collect()
}

fn words(values: impl Iterator<Item = u32>) -> Vec<u8> {
    values.flat_map(u32::to_le_bytes).collect()
}
