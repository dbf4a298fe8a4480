use crate::camera::{Camera, Frame, Lens};
use crate::canvas::{Canvas, NOTHING, SIDE};
use crate::light::lit;
use crate::raster::Raster;
use crate::shade::{Shader, Surface};
use crate::triangle::Outline;
use avln_geom::RayMesh;
use avln_scene::{InstanceId, Scene};
use std::sync::{Arc, OnceLock};

/// Takes pictures of one building. The same camera always gives the same bytes.
pub struct Renderer {
    scene: Arc<Scene>,
    rays: Arc<RayMesh>,
    shader: Shader,
    /// What is drawn; made for the first picture.
    drawn: OnceLock<Drawn>,
}

/// The surfaces with their light; of the scene, only what they need.
struct Drawn {
    scene: Arc<Scene>,
    rays: Arc<RayMesh>,
}

impl Renderer {
    /// A renderer of `scene`, whose triangles `rays` holds in the same order.
    pub fn new(scene: Arc<Scene>, rays: Arc<RayMesh>) -> Self {
        let shader = Shader::new(&scene);
        Self { scene, rays, shader, drawn: OnceLock::new() }
    }

    /// What is drawn: the scene itself, or its surfaces with the light of its lamps.
    fn drawn(&self) -> &Drawn {
        self.drawn.get_or_init(|| match lit(&self.scene, &self.rays) {
            None => Drawn { scene: Arc::clone(&self.scene), rays: Arc::clone(&self.rays) },
            Some(mesh) => {
                let rays = Arc::new(RayMesh::new(&mesh.positions, &mesh.triangles));
                let Scene { materials, lighting, .. } = &*self.scene;
                let scene = Scene {
                    name: String::new(),
                    mesh,
                    materials: materials.clone(),
                    textures: Vec::new(),
                    regions: Vec::new(),
                    objects: Vec::new(),
                    lighting: lighting.clone(),
                };
                Drawn { scene: Arc::new(scene), rays }
            }
        })
    }

    /// What `camera` sees. The first picture of a scene with lamps takes longer: it waits for their light. Surfaces have two sides; texels below their material's alpha cutoff are not there.
    pub fn render(&self, camera: &Camera) -> Frame {
        let lens = camera.lens();
        let canvas = self.trace(camera, &lens);
        let mut frame = Frame::empty(camera, self.scene.lighting.backdrop_rgb());
        for row in 0..canvas.tiles[1] {
            for column in 0..canvas.tiles[0] {
                self.develop(&canvas, [column, row], &lens, camera.depth_max_m, &mut frame);
            }
        }
        frame
    }

    /// The nearest hit of every pixel's ray.
    fn trace(&self, camera: &Camera, lens: &Lens) -> Canvas {
        let canvas = Canvas::new([camera.width as usize, camera.height as usize]);
        let mut raster = Raster { scene: &self.drawn().scene, lens: *lens, canvas, shader: &self.shader };
        self.drawn().rays.visit(&mut raster);
        raster.canvas
    }

    /// Writes one tile's pixels into the frame.
    fn develop(
        &self,
        canvas: &Canvas,
        [column, row]: [usize; 2],
        lens: &Lens,
        depth_max_m: f32,
        frame: &mut Frame,
    ) {
        let tile = canvas.tile(column, row);
        let scene = &self.drawn().scene;
        let (left, top) = (column * SIDE, row * SIDE);
        let (width, height) = (SIDE.min(canvas.size[0] - left), SIDE.min(canvas.size[1] - top));
        let mut current: Option<(u32, Surface)> = None;
        for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
            let triangle = tile.triangle[y * SIDE + x];
            if triangle == NOTHING {
                continue;
            }
            if current.as_ref().is_none_or(|(of, _)| *of != triangle) {
                current = self.surface(lens, triangle).map(|surface| (triangle, surface));
            }
            let pixel = (top + y) * canvas.size[0] + left + x;
            let depth_m = 1.0 / tile.nearness[y * SIDE + x];
            frame.depth[pixel] = if depth_m <= depth_max_m { depth_m } else { 0.0 };
            frame.instances[pixel] = scene.mesh.instance_of[triangle as usize];
            if let Some((_, surface)) = &current {
                let at = |index: usize, half: f32| index as f32 + 0.5 - half;
                let color = surface.color(at(left + x, lens.half[0]), at(top + y, lens.half[1]), depth_m);
                frame.rgb[3 * pixel..3 * pixel + 3].copy_from_slice(&color);
            }
        }
    }

    fn surface(&self, lens: &Lens, triangle: u32) -> Option<Surface<'_>> {
        let scene = &self.drawn().scene;
        let corners = lens.corners(scene, triangle);
        let outline = Outline::new(&corners)?;
        Some(self.shader.surface(scene, lens, triangle, &corners, &outline))
    }
}

impl Frame {
    /// Nothing but the backdrop.
    fn empty(camera: &Camera, backdrop_rgb: [u8; 3]) -> Self {
        let pixels = camera.width as usize * camera.height as usize;
        Self {
            width: camera.width,
            height: camera.height,
            rgb: backdrop_rgb.repeat(pixels),
            depth: vec![0.0; pixels],
            instances: vec![InstanceId::NONE; pixels],
        }
    }
}
