//! The demo's own scene: sculptures on a lawn before a lake, trees, hills and mountains.

use glam::{Affine3A, Vec3};

use super::mesh::Part;
use super::random::Random;
use super::terrain::{self, from_lake, height, normal, water};
use super::tree::{Tree, broadleaf, conifer, grass_tuft, upright_transform};
use super::{
    Camera, Material, Model, NONE, Procedural, Roles, Scene, Shape, Sun, kind, paint, shapes,
};

const TAU: f32 = std::f32::consts::TAU;

pub fn landscape() -> Scene {
    let parts = LandscapeParts::make();
    let mut scene = Scene {
        vertices: Vec::new(),
        indices: Vec::new(),
        geometries: Vec::new(),
        meshes: Vec::new(),
        procedurals: Vec::new(),
        instances: Vec::new(),
        materials: Vec::new(),
        textures: parts.textures,
        camera: Camera {
            position: Vec3::new(0.5, 2.55, 13.4),
            forward: Vec3::new(-0.03, 0.012, -1.0),
            up: Vec3::Y,
            fov_y: 0.80,
        },
        sun: Sun {
            direction: Vec3::new(-0.58, 0.55, 0.46).normalize(),
            irradiance: Vec3::new(5.2, 4.05, 2.75),
            angular_radius: 0.016,
        },
        haze: (Vec3::new(0.74, 0.79, 0.86), 0.0007),
        roles: Roles {
            grass: 0,
            rock: 1,
            sand: 2,
            clouds: 3,
        },
        exposure: 0.88,
        extent: 60.0,
    };
    let ground = scene.add_material(Material {
        kind: kind::TERRAIN,
        ..Material::default()
    });
    let lake = scene.add_material(Material {
        kind: kind::WATER,
        base_color: Vec3::ONE,
        roughness: 0.0,
        absorption: Vec3::new(0.9, 0.32, 0.26),
        ior: 1.33,
        ..Material::default()
    });
    let land = scene.add_mesh(&[(&parts.terrain, ground)]);
    scene.place(land, Affine3A::IDENTITY);
    let surface = scene.add_mesh(&[(&water(), lake)]);
    scene.place(surface, Affine3A::IDENTITY);

    plant_trees(&mut scene, &parts.trees);
    sow_grass(&mut scene, &parts.grass);
    set_sculptures(&mut scene, &parts.knot);
    scatter_boulders(&mut scene, &parts.boulders);
    scene
}

/// Parts that take long to make, made in parallel.
struct LandscapeParts {
    terrain: Part,
    knot: Part,
    trees: Vec<Tree>,
    grass: Vec<Part>,
    boulders: Vec<Part>,
    textures: Vec<super::Texture>,
}

// Textures after the four that have roles.
const BARK: u32 = 4;
const LEAVES: u32 = 5;
const AUTUMN_LEAVES: u32 = 6;
const NEEDLES: u32 = 7;
const BLADES: u32 = 8;
const SLABS: u32 = 9;

impl LandscapeParts {
    fn make() -> LandscapeParts {
        let (mut terrain, mut knot) = (Part::default(), Part::default());
        let (mut trees, mut grass, mut boulders) = (Vec::new(), Vec::new(), Vec::new());
        let mut textures = Vec::new();
        rayon::scope(|scope| {
            scope.spawn(|_| terrain = terrain::terrain());
            scope.spawn(|_| knot = shapes::torus_knot(900, 56));
            scope.spawn(|_| {
                trees.extend([101, 202, 303].map(broadleaf));
                trees.extend([404, 505].map(conifer));
            });
            scope.spawn(|_| grass.extend([61, 62, 63].map(|seed| grass_tuft(seed, 650))));
            scope.spawn(|_| boulders.extend([1, 2].map(|seed| shapes::boulder(24, seed))));
            scope.spawn(|_| {
                textures = vec![
                    paint::grass(),
                    paint::rock(),
                    paint::sand(),
                    paint::clouds(),
                    paint::bark(),
                    paint::leaves(false),
                    paint::leaves(true),
                    paint::needles(),
                    paint::blades(),
                    paint::slabs(),
                ];
            });
        });
        LandscapeParts {
            terrain,
            knot,
            trees,
            grass,
            boulders,
            textures,
        }
    }
}

fn tree_models(scene: &mut Scene, trees: &[Tree]) -> Vec<Model> {
    let textured = |texture: u32| Material {
        base_texture: texture,
        ..Material::default()
    };
    let bark = scene.add_material(Material {
        base_color: Vec3::ONE,
        ..textured(BARK)
    });
    let mut foliage = |texture: u32, tint: Vec3, translucency: f32| {
        scene.add_material(Material {
            base_color: tint,
            alpha_cutoff: 0.5,
            translucency,
            ..textured(texture)
        })
    };
    let green = foliage(LEAVES, Vec3::ONE, 0.4);
    let olive = foliage(LEAVES, Vec3::new(1.3, 1.05, 0.8), 0.4);
    let autumn = foliage(AUTUMN_LEAVES, Vec3::ONE, 0.4);
    let needles = foliage(NEEDLES, Vec3::ONE, 0.2);
    [
        (&trees[0], green),
        (&trees[1], olive),
        (&trees[2], green),
        (&trees[3], needles),
        (&trees[4], needles),
        (&trees[2], autumn),
    ]
    .into_iter()
    .map(|(tree, leaves)| scene.add_mesh(&[(&tree.wood, bark), (&tree.leaves, leaves)]))
    .collect()
}

fn plant_trees(scene: &mut Scene, trees: &[Tree]) {
    let models = tree_models(scene, trees);
    let mut random = Random::new(7);
    let mut planted: Vec<(f32, f32, f32)> = Vec::new();
    let plant = |scene: &mut Scene, model: usize, x: f32, z: f32, size: f32, turn: f32| {
        let foot = Vec3::new(x, height(x, z) - 0.05, z);
        let shape = Vec3::new(size * 1.05, size, size * 1.05);
        scene.place(models[model], upright_transform(foot, turn, shape));
    };
    // The frame: chosen trees at both sides of the view.
    for (model, x, z, size, turn) in [
        (0, -12.6, -2.6, 1.05, 0.4),
        (5, 12.6, -1.2, 0.95, 2.0),
        (1, 17.5, -4.5, 1.15, 4.0),
        (3, -17.5, -5.5, 1.1, 1.0),
        (2, -21.5, -0.5, 1.0, 3.0),
        (4, 20.5, 2.5, 1.05, 5.0),
    ] {
        plant(scene, model, x, z, size, turn);
        planted.push((x, z, 4.0));
    }
    // The woods: wherever the dice fall on dry, not too steep ground, apart from each other.
    let mut tries = 0;
    while planted.len() < 420 && tries < 20_000 {
        tries += 1;
        let near = tries < 4_000;
        let (reach, deep) = if near { (62.0, 75.0) } else { (170.0, 190.0) };
        let x = random.between(-reach, reach);
        let z = random.between(-deep, 8.0);
        let size = random.between(0.72, 1.2);
        let (turn, kind, wish) = (random.between(0.0, TAU), random.unit(), random.unit());
        let density = 0.25 + 0.75 * super::noise::gradient(x * 0.05, z * 0.05, 0, 77).max(-0.3);
        let steep = normal(x, z, 0.5).y < 0.8;
        // The sun comes over the left shoulder: what stands there would shade everything.
        let on_lawn = (-30.0..13.0).contains(&x) && z > -9.0;
        let blocks_view = x.abs() < 2.0 + 0.42 * (15.0 - z) && z > -6.0;
        if from_lake(x, z) < 1.22 || steep || on_lawn || blocks_view || wish > density {
            continue;
        }
        let apart = if near { 3.6 } else { 4.4 };
        if planted.iter().any(|(px, pz, r)| {
            let (dx, dz) = (px - x, pz - z);
            dx * dx + dz * dz < apart * r
        }) {
            continue;
        }
        planted.push((x, z, apart));
        let high = height(x, z) > 9.0;
        let model = match kind {
            k if high && k < 0.75 => 3 + (turn * 10.0) as usize % 2,
            k if k < 0.28 => 0,
            k if k < 0.52 => 1,
            k if k < 0.74 => 2,
            k if k < 0.84 => 5,
            _ => 3 + (turn * 10.0) as usize % 2,
        };
        plant(scene, model, x, z, size, turn);
    }
}

fn sow_grass(scene: &mut Scene, tufts: &[Part]) {
    let blades = scene.add_material(Material {
        base_color: Vec3::ONE,
        base_texture: BLADES,
        translucency: 0.35,
        ..Material::default()
    });
    let models: Vec<Model> = tufts
        .iter()
        .map(|tuft| scene.add_mesh(&[(tuft, blades)]))
        .collect();
    let mut random = Random::new(23);
    let spacing = 1.55;
    for row in 0..14 {
        for column in -11..=11 {
            let x = column as f32 * spacing + random.between(-0.5, 0.5);
            let z = 13.4 - row as f32 * spacing + random.between(-0.5, 0.5);
            let size = random.between(0.75, 1.15);
            let turn = random.between(0.0, TAU);
            let model = models[(random.bits() >> 7) as usize % models.len()];
            let on_terrace = (x + 0.2).abs() < 7.4 && (z - 3.2).abs() < 4.2;
            let seen = x.abs() < 3.0 + 0.75 * (15.5 - z);
            if on_terrace || !seen || height(x, z) < 0.42 {
                continue;
            }
            let ground = normal(x, z, 0.4);
            let upright = upright_transform(Vec3::new(x, height(x, z), z), turn, Vec3::splat(size));
            // Shear, so that the tuft follows the slope and its blades stay upright.
            let mut slope = Affine3A::IDENTITY;
            slope.matrix3.x_axis.y = -ground.x / ground.y;
            slope.matrix3.z_axis.y = -ground.z / ground.y;
            let foot = upright.translation;
            let mut shape = upright;
            shape.translation = glam::Vec3A::ZERO;
            let mut placed = slope * shape;
            placed.translation = foot;
            scene.place(model, placed);
        }
    }
}

/// The materials of the sculptures.
struct SculptureMaterials {
    stone: u32,
    marble: u32,
    gold: u32,
    copper: u32,
    chrome: u32,
    clear: u32,
    blue: u32,
    amber: u32,
}

impl SculptureMaterials {
    fn new(scene: &mut Scene) -> Self {
        let stone = scene.add_material(Material {
            base_color: Vec3::ONE,
            base_texture: SLABS,
            ..Material::default()
        });
        let marble = scene.add_material(Material {
            base_color: Vec3::new(0.62, 0.58, 0.51),
            roughness: 0.8,
            ..Material::default()
        });
        let gold = scene.add_material(Material {
            base_color: Vec3::new(1.0, 0.72, 0.30),
            roughness: 0.16,
            metallic: 1.0,
            ..Material::default()
        });
        let copper = scene.add_material(Material {
            base_color: Vec3::new(0.93, 0.50, 0.36),
            roughness: 0.34,
            metallic: 0.75,
            ..Material::default()
        });
        let chrome = scene.add_material(Material {
            base_color: Vec3::new(0.93, 0.94, 0.95),
            roughness: 0.03,
            metallic: 1.0,
            ..Material::default()
        });
        let glass = |absorption: Vec3| Material {
            kind: kind::GLASS,
            base_color: Vec3::ONE,
            roughness: 0.0,
            absorption,
            ior: 1.5,
            ..Material::default()
        };
        let clear = scene.add_material(glass(Vec3::new(0.05, 0.02, 0.03)));
        let blue = scene.add_material(glass(Vec3::new(2.6, 0.9, 0.25)));
        let amber = scene.add_material(glass(Vec3::new(0.2, 1.1, 4.0)));
        Self {
            stone,
            marble,
            gold,
            copper,
            chrome,
            clear,
            blue,
            amber,
        }
    }
}

fn set_sculptures(scene: &mut Scene, knot: &Part) {
    let SculptureMaterials {
        stone,
        marble,
        gold,
        copper,
        chrome,
        clear,
        blue,
        amber,
    } = SculptureMaterials::new(scene);

    // A terrace of slabs on the lawn; everything stands on it.
    let floor = height(0.0, 3.0) + 0.22;
    let at = |x: f32, y: f32, z: f32| Vec3::new(x, floor + y, z);
    let block = |scene: &mut Scene, half: Vec3, bevel: f32, material: u32, centre: Vec3| {
        let model = scene.add_mesh(&[(&shapes::block(half, bevel), material)]);
        scene.place(model, Affine3A::from_translation(centre));
    };
    for (half, y) in [
        (Vec3::new(6.8, 0.6, 3.4), -0.6),
        (Vec3::new(7.3, 0.5, 3.9), -0.68),
    ] {
        block(scene, half, 0.05, stone, at(-0.2, y, 3.2));
    }

    // Menger's sponge in copper, on a corner of its plinth.
    let plinth = Vec3::new(1.0, 0.28, 1.0);
    block(scene, plinth, 0.04, marble, at(-4.4, 0.28, 2.6));
    let sponge = scene.add_procedural(Procedural {
        shape: Shape::Sponge,
        centre: Vec3::ZERO,
        radius: 1.12,
        material: copper,
    });
    scene.place(
        sponge,
        upright_transform(at(-4.4, 0.56 + 1.125, 2.6), 0.62, Vec3::ONE),
    );

    // The knot in gold.
    block(scene, plinth, 0.04, marble, at(4.1, 0.28, 2.6));
    let knot = scene.add_mesh(&[(knot, gold)]);
    scene.place(
        knot,
        upright_transform(at(4.1, 0.56 + 1.66, 2.6), -0.35, Vec3::splat(0.98)),
    );

    // Balls of glass and metal.
    for (x, z, radius, material) in [
        (-0.2, 2.2, 1.35, clear),
        (2.05, 4.5, 0.52, chrome),
        (-2.1, 4.6, 0.44, blue),
        (0.75, 5.3, 0.30, amber),
        (-0.75, 5.45, 0.24, gold),
        (-3.3, 5.4, 0.22, chrome),
        (3.35, 5.2, 0.33, clear),
    ] {
        let ball = scene.add_procedural(Procedural {
            shape: Shape::Sphere,
            centre: Vec3::ZERO,
            radius,
            material,
        });
        scene.place(ball, Affine3A::from_translation(at(x, radius + 0.002, z)));
    }
}

fn scatter_boulders(scene: &mut Scene, boulders: &[Part]) {
    let granite = scene.add_material(Material {
        base_color: Vec3::splat(0.95),
        base_texture: 1,
        ..Material::default()
    });
    debug_assert_ne!(scene.roles.rock, NONE);
    let models: Vec<Model> = boulders
        .iter()
        .map(|boulder| scene.add_mesh(&[(boulder, granite)]))
        .collect();
    let mut random = Random::new(99);
    let mut placed = 0;
    while placed < 70 {
        let (x, z) = (random.between(-40.0, 45.0), random.between(-55.0, 4.0));
        let (size, turn) = (random.unit(), random.between(0.0, TAU));
        let model = models[placed % models.len()];
        let r = from_lake(x, z);
        if !(0.9..1.16).contains(&r) {
            continue;
        }
        placed += 1;
        let size = 0.18 + 0.75 * size * size * size;
        let foot = Vec3::new(x, height(x, z) + 0.12 * size, z);
        scene.place(
            model,
            upright_transform(foot, turn, Vec3::new(size * 1.25, size * 0.8, size)),
        );
    }
}
