//! Scenes from glTF files: meshes, nodes as instances, materials, textures and the first camera.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use glam::{Affine3A, Mat4, Vec3};
use gltf::image::{Data, Format};
use gltf::material::AlphaMode;
use gltf::texture::WrappingMode;

use super::mesh::Part;
use super::{
    BY_CHANCE, Camera, Material, Model, NONE, Roles, Scene, Sun, Texture, Vertex, Wrap, kind, paint,
};

pub fn load(path: &Path) -> Result<Scene> {
    check(path)?;
    let (document, buffers, images) =
        gltf::import(path).with_context(|| format!("reading {}", path.display()))?;
    let gltf_scene = document
        .default_scene()
        .or_else(|| document.scenes().next())
        .context("the file has no scene")?;
    let mut import = Import {
        scene: empty_scene(),
        buffers: &buffers,
        images: &images,
        textures: HashMap::new(),
        materials: HashMap::new(),
        meshes: HashMap::new(),
        camera: None,
        low: Vec3::INFINITY,
        high: Vec3::NEG_INFINITY,
    };
    for node in gltf_scene.nodes() {
        import.node(&node, Mat4::IDENTITY)?;
    }
    ensure!(
        !import.scene.instances.is_empty(),
        "the scene has no triangles"
    );
    let Import {
        mut scene,
        camera,
        low,
        high,
        ..
    } = import;
    scene.extent = (high - low).length();
    scene.camera = camera.unwrap_or_else(|| looking_at(low, high));
    Ok(scene)
}

/// Extensions without which some files make no sense, and which are read here.
const READ_EXTENSIONS: [&str; 5] = [
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_transmission",
    "KHR_texture_transform",
];

/// Names the fault of a file that cannot be read for a plain reason.
fn check(path: &Path) -> Result<()> {
    let bytes = std::fs::read(path).with_context(|| format!("reading {}", path.display()))?;
    let is_gltf = bytes.starts_with(b"glTF") || bytes.trim_ascii_start().starts_with(b"{");
    ensure!(is_gltf, "{} is no glTF file", path.display());
    let parsed = gltf::Gltf::from_slice_without_validation(&bytes)
        .with_context(|| format!("{} is no glTF 2.0 file", path.display()))?;
    let unread: Vec<&str> = parsed
        .extensions_required()
        .filter(|name| !READ_EXTENSIONS.contains(name))
        .collect();
    ensure!(
        unread.is_empty(),
        "{} needs {}, which the demo does not read",
        path.display(),
        unread.join(" and ")
    );
    for uri in uris(&parsed) {
        let beside = |name: &Path| path.with_file_name("").join(name);
        // URIs are percent-encoded (RFC 3986); some writers leave names as they are.
        let is_there = beside(Path::new(uri)).exists() || beside(&decoded(uri)).exists();
        ensure!(
            is_there,
            "{} needs {uri}, which is not there",
            path.display()
        );
    }
    Ok(())
}

/// The files that a scene refers to.
fn uris(parsed: &gltf::Gltf) -> Vec<&str> {
    let buffers = parsed.buffers().filter_map(|buffer| match buffer.source() {
        gltf::buffer::Source::Uri(uri) => Some(uri),
        gltf::buffer::Source::Bin => None,
    });
    let images = parsed.images().filter_map(|image| match image.source() {
        gltf::image::Source::Uri { uri, .. } => Some(uri),
        gltf::image::Source::View { .. } => None,
    });
    // Data that stands in the file itself has a scheme; so have files elsewhere, which the reader
    // refuses.
    (buffers.chain(images))
        .filter(|uri| !uri.contains(':'))
        .collect()
}

/// The file name that a percent-encoded URI means.
fn decoded(uri: &str) -> PathBuf {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let [first, tail @ ..] = rest {
        let code = (*first == b'%' && tail.len() >= 2)
            .then(|| std::str::from_utf8(&tail[..2]).ok())
            .flatten()
            .and_then(|digits| u8::from_str_radix(digits, 16).ok());
        bytes.push(code.unwrap_or(*first));
        rest = match code {
            Some(_) => &tail[2..],
            None => tail,
        };
    }
    // URIs of glTF encode UTF-8 (glTF 2.0, section 2.8).
    String::from_utf8_lossy(&bytes).into_owned().into()
}

fn empty_scene() -> Scene {
    Scene {
        vertices: Vec::new(),
        indices: Vec::new(),
        geometries: Vec::new(),
        meshes: Vec::new(),
        procedurals: Vec::new(),
        instances: Vec::new(),
        materials: Vec::new(),
        textures: vec![paint::clouds()],
        camera: looking_at(Vec3::NEG_ONE, Vec3::ONE),
        sun: Sun {
            direction: Vec3::new(0.45, 0.75, 0.5).normalize(),
            irradiance: Vec3::new(4.0, 3.6, 3.1),
            angular_radius: 0.02,
        },
        haze: (Vec3::new(0.74, 0.79, 0.86), 0.0),
        roles: Roles {
            grass: NONE,
            rock: NONE,
            sand: NONE,
            clouds: 0,
        },
        exposure: 0.9,
        extent: 1.0,
    }
}

/// A view of the whole box from its front, a little from above.
fn looking_at(low: Vec3, high: Vec3) -> Camera {
    let centre = (low + high) * 0.5;
    let radius = ((high - low).length() * 0.5).max(1e-6);
    let from = Vec3::new(0.55, 0.38, 1.0).normalize();
    let fov_y = 0.7f32;
    let distance = radius / libm::sinf(fov_y * 0.5);
    Camera {
        position: centre + from * distance,
        forward: -from,
        up: Vec3::Y,
        fov_y,
    }
}

struct Import<'a> {
    scene: Scene,
    buffers: &'a [gltf::buffer::Data],
    images: &'a [Data],
    /// By texture index and whether it holds colours.
    textures: HashMap<(usize, bool), u32>,
    /// By material index; `None` is glTF's default material.
    materials: HashMap<Option<usize>, u32>,
    meshes: HashMap<usize, Option<(Model, Vec3, Vec3)>>,
    camera: Option<Camera>,
    low: Vec3,
    high: Vec3,
}

impl Import<'_> {
    fn node(&mut self, node: &gltf::Node, parent: Mat4) -> Result<()> {
        let here = parent * Mat4::from_cols_array_2d(&node.transform().matrix());
        if let Some(mesh) = node.mesh()
            && let Some((model, low, high)) = self.mesh(&mesh)?
        {
            // A node may be scaled to nothing to hide it.
            if !here.is_finite() || here.determinant() == 0.0 {
                return Ok(());
            }
            self.scene.place(model, Affine3A::from_mat4(here));
            for corner in 0..8 {
                let pick = |axis: usize| if corner >> axis & 1 == 0 { low } else { high }[axis];
                let at = here.transform_point3(Vec3::new(pick(0), pick(1), pick(2)));
                self.low = self.low.min(at);
                self.high = self.high.max(at);
            }
        }
        if let (None, Some(camera)) = (self.camera, node.camera())
            && let gltf::camera::Projection::Perspective(lens) = camera.projection()
        {
            self.camera = Some(Camera {
                position: here.w_axis.truncate(),
                forward: -here.z_axis.truncate().normalize(),
                up: here.y_axis.truncate().normalize(),
                fov_y: lens.yfov(),
            });
        }
        node.children()
            .try_for_each(|child| self.node(&child, here))
    }

    /// The model of a mesh with its bounds; `None` when it has no triangles.
    fn mesh(&mut self, mesh: &gltf::Mesh) -> Result<Option<(Model, Vec3, Vec3)>> {
        if let Some(known) = self.meshes.get(&mesh.index()) {
            return Ok(*known);
        }
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        let mut parts = Vec::new();
        for primitive in mesh.primitives() {
            let Some(part) = self.part(&primitive)? else {
                continue;
            };
            for vertex in &part.vertices {
                low = low.min(vertex.position);
                high = high.max(vertex.position);
            }
            let material = self.material(&primitive.material())?;
            parts.push((part, material));
        }
        let parts: Vec<(&Part, u32)> = parts.iter().map(|(part, m)| (part, *m)).collect();
        let model = (!parts.is_empty()).then(|| (self.scene.add_mesh(&parts), low, high));
        self.meshes.insert(mesh.index(), model);
        Ok(model)
    }

    fn part(&self, primitive: &gltf::Primitive) -> Result<Option<Part>> {
        use gltf::mesh::Mode;
        let reader = primitive.reader(|buffer| self.buffers.get(buffer.index()).map(|b| &b.0[..]));
        let Some(positions) = reader.read_positions() else {
            return Ok(None);
        };
        let positions: Vec<Vec3> = positions.map(Vec3::from).collect();
        let numbered: Vec<u32> = match reader.read_indices() {
            Some(indices) => indices.into_u32().collect(),
            None => (0..positions.len() as u32).collect(),
        };
        let indices: Vec<u32> = match primitive.mode() {
            Mode::Triangles => numbered.chunks_exact(3).flatten().copied().collect(),
            Mode::TriangleStrip => numbered
                .windows(3)
                .enumerate()
                .flat_map(|(i, w)| {
                    if i % 2 == 0 {
                        [w[0], w[1], w[2]]
                    } else {
                        [w[1], w[0], w[2]]
                    }
                })
                .collect(),
            Mode::TriangleFan => numbered
                .windows(2)
                .skip(1)
                .flat_map(|w| [numbered[0], w[0], w[1]])
                .collect(),
            _ => return Ok(None),
        };
        ensure!(
            indices
                .iter()
                .all(|index| (*index as usize) < positions.len()),
            "an index points past the vertices"
        );
        if indices.is_empty() {
            return Ok(None);
        }
        let normals: Option<Vec<Vec3>> = reader
            .read_normals()
            .map(|normals| normals.map(Vec3::from).collect());
        let mapping = Mapping::of(&primitive.material());
        let uvs: Option<Vec<[f32; 2]>> = reader
            .read_tex_coords(mapping.set)
            .map(|coordinates| coordinates.into_f32().map(|uv| mapping.apply(uv)).collect());
        let vertices: Vec<Vertex> = (0..positions.len())
            .map(|i| {
                let [u, v] = uvs
                    .as_ref()
                    .and_then(|uvs| uvs.get(i))
                    .copied()
                    .unwrap_or_default();
                let given = normals.as_ref().and_then(|normals| normals.get(i));
                let normal = given.copied().unwrap_or(Vec3::Y);
                Vertex {
                    position: positions[i],
                    u,
                    normal,
                    v,
                }
            })
            .collect();
        Ok(Some(match normals {
            Some(_) => Part { vertices, indices },
            None => faceted(&vertices, &indices),
        }))
    }

    fn material(&mut self, material: &gltf::Material) -> Result<u32> {
        if let Some(known) = self.materials.get(&material.index()) {
            return Ok(*known);
        }
        let surface = material.pbr_metallic_roughness();
        let [r, g, b, a] = surface.base_color_factor();
        let strength = material.emissive_strength().unwrap_or(1.0);
        let mut made = Material {
            base_color: Vec3::new(r, g, b),
            roughness: surface.roughness_factor().max(0.02),
            metallic: surface.metallic_factor(),
            emission: Vec3::from(material.emissive_factor()) * strength,
            ..Material::default()
        };
        let mut clear = material
            .transmission()
            .is_some_and(|transmission| transmission.transmission_factor() > 0.5);
        match material.alpha_mode() {
            AlphaMode::Opaque => {}
            AlphaMode::Mask => made.alpha_cutoff = material.alpha_cutoff().unwrap_or(0.5),
            // A uniformly faint material is glass; otherwise rays pass at random, as often as it is
            // clear.
            AlphaMode::Blend if surface.base_color_texture().is_none() && a < 0.6 => clear = true,
            AlphaMode::Blend => made.alpha_cutoff = BY_CHANCE,
        }
        if clear {
            made.kind = kind::GLASS;
            made.ior = material.ior().unwrap_or(1.5);
            made.alpha_cutoff = 0.0;
        }
        if let Some(glossy) = material.pbr_specular_glossiness() {
            let [r, g, b, _] = glossy.diffuse_factor();
            let specular = Vec3::from(glossy.specular_factor());
            made.roughness = (1.0 - glossy.glossiness_factor()).max(0.02);
            // A material with coloured reflection and no scattering is a metal.
            let is_metal = specular.max_element() > 0.5 && Vec3::new(r, g, b).max_element() < 0.2;
            made.metallic = if is_metal { 1.0 } else { 0.0 };
            made.base_color = if is_metal {
                specular
            } else {
                Vec3::new(r, g, b)
            };
            if let Some(info) = glossy.diffuse_texture() {
                made.base_texture = self.texture(&info.texture(), true)?;
            }
        } else if let Some(info) = surface.base_color_texture() {
            made.base_texture = self.texture(&info.texture(), true)?;
        }
        if let Some(info) = surface.metallic_roughness_texture() {
            made.metal_rough_texture = self.texture(&info.texture(), false)?;
        }
        if let Some(info) = material.normal_texture() {
            made.normal_texture = self.texture(&info.texture(), false)?;
            made.normal_scale = info.scale();
        }
        if let Some(info) = material.emissive_texture() {
            made.emission_texture = self.texture(&info.texture(), true)?;
        }
        let made = self.scene.add_material(made);
        self.materials.insert(material.index(), made);
        Ok(made)
    }

    fn texture(&mut self, texture: &gltf::Texture, srgb: bool) -> Result<u32> {
        let key = (texture.index(), srgb);
        if let Some(known) = self.textures.get(&key) {
            return Ok(*known);
        }
        let image = self
            .images
            .get(texture.source().index())
            .context("a texture has no image")?;
        let wrap = match texture.sampler().wrap_s() {
            WrappingMode::Repeat => Wrap::Repeat,
            WrappingMode::ClampToEdge => Wrap::Clamp,
            WrappingMode::MirroredRepeat => Wrap::Mirror,
        };
        let made = Texture::new(image.width, image.height, texels(image)?, srgb, wrap);
        let made = self.scene.add_texture(made);
        self.textures.insert(key, made);
        Ok(made)
    }
}

/// Which texture coordinates a material uses, and what becomes of them (`KHR_texture_transform`).
/// The renderer has one pair a vertex, so the material's first texture decides for all.
struct Mapping {
    set: u32,
    offset: [f32; 2],
    rotation: f32,
    scale: [f32; 2],
}

impl Mapping {
    fn of(material: &gltf::Material) -> Mapping {
        let surface = material.pbr_metallic_roughness();
        let glossy = material.pbr_specular_glossiness();
        let diffuse = glossy.and_then(|glossy| glossy.diffuse_texture());
        let first = diffuse
            .or(surface.base_color_texture())
            .or(surface.metallic_roughness_texture())
            .or(material.emissive_texture());
        let transform = first.as_ref().and_then(|info| info.texture_transform());
        let set = first.as_ref().map_or(0, |info| info.tex_coord());
        Mapping {
            set: transform
                .as_ref()
                .and_then(|transform| transform.tex_coord())
                .unwrap_or(set),
            offset: transform.as_ref().map_or([0.0; 2], |it| it.offset()),
            rotation: transform.as_ref().map_or(0.0, |it| it.rotation()),
            scale: transform.as_ref().map_or([1.0; 2], |it| it.scale()),
        }
    }

    /// Scales, then rotates, then moves.
    fn apply(&self, [u, v]: [f32; 2]) -> [f32; 2] {
        let (u, v) = (u * self.scale[0], v * self.scale[1]);
        let (sine, cosine) = (libm::sinf(self.rotation), libm::cosf(self.rotation));
        [
            self.offset[0] + cosine * u + sine * v,
            self.offset[1] - sine * u + cosine * v,
        ]
    }
}

/// Eight bits of each channel, whatever the file has.
fn texels(image: &Data) -> Result<Vec<[u8; 4]>> {
    let bytes = &image.pixels;
    let high = |pixel: &[u8], channel: usize| pixel[2 * channel + 1];
    Ok(match image.format {
        Format::R8 => bytes.iter().map(|r| [*r, *r, *r, 255]).collect(),
        Format::R8G8 => bytes
            .chunks_exact(2)
            .map(|p| [p[0], p[1], 0, 255])
            .collect(),
        Format::R8G8B8 => bytes
            .chunks_exact(3)
            .map(|p| [p[0], p[1], p[2], 255])
            .collect(),
        Format::R8G8B8A8 => bytes
            .chunks_exact(4)
            .map(|p| [p[0], p[1], p[2], p[3]])
            .collect(),
        Format::R16 => bytes
            .chunks_exact(2)
            .map(|p| [p[1], p[1], p[1], 255])
            .collect(),
        Format::R16G16 => bytes
            .chunks_exact(4)
            .map(|p| [high(p, 0), high(p, 1), 0, 255])
            .collect(),
        Format::R16G16B16 => bytes
            .chunks_exact(6)
            .map(|p| [high(p, 0), high(p, 1), high(p, 2), 255])
            .collect(),
        Format::R16G16B16A16 => bytes
            .chunks_exact(8)
            .map(|p| [high(p, 0), high(p, 1), high(p, 2), high(p, 3)])
            .collect(),
        other => bail!("images of format {other:?} are not supported"),
    })
}

/// A mesh that has no normals has flat faces (glTF 2.0, "Meshes"): each triangle gets vertices of
/// its own.
fn faceted(vertices: &[Vertex], indices: &[u32]) -> Part {
    let corners = indices.chunks_exact(3).flat_map(|triangle| {
        let corners = [0, 1, 2].map(|corner| vertices[triangle[corner] as usize]);
        let [a, b, c] = corners.map(|corner| corner.position);
        let normal = (b - a).cross(c - a).normalize_or(Vec3::Y);
        corners.map(|corner| Vertex { normal, ..corner })
    });
    let vertices: Vec<Vertex> = corners.collect();
    let indices = (0..vertices.len() as u32).collect();
    Part { vertices, indices }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_buffer_is_named() {
        let name = format!("tuff-gltf-{}.gltf", std::process::id());
        let path = std::env::temp_dir().join(name);
        let text = r#"{"asset":{"version":"2.0"},"buffers":[{"uri":"no such%20file.bin","byteLength":4}]}"#;
        std::fs::write(&path, text).unwrap();
        let message = format!("{:#}", load(&path).expect_err("the buffer is not there"));
        let beside = path.with_file_name("no such file.bin");
        std::fs::write(&beside, [0; 4]).unwrap();
        let found = check(&path);
        std::fs::remove_file(&path).unwrap();
        std::fs::remove_file(&beside).unwrap();
        assert!(
            message.contains("needs no such%20file.bin, which is not there"),
            "{message}"
        );
        assert!(found.is_ok(), "{found:?}");
    }
}
