//! Where nodes stand: local matrices and the walk over the node tree.

use super::container::missing;
use super::schema::{Document, Node};
use crate::files::Checked;
use nalgebra::{Matrix4, Quaternion, UnitQuaternion, Vector3};

/// A node of the scene with its parent and its transform.
pub(super) struct Placed {
    pub(super) node: usize,
    /// Index of the parent among the placed nodes.
    pub(super) parent: Option<usize>,
    pub(super) world_from_node: Matrix4<f64>,
}

/// The nodes of the default scene (all roots where the file has no scene), parents before children.
pub(super) fn placed_nodes(document: &Document) -> Checked<Vec<Placed>> {
    let mut seen = vec![false; document.nodes.len()];
    let mut placed = Vec::new();
    let mut open: Vec<Placed> = Vec::new();
    for root in roots(document)?.into_iter().rev() {
        open.push(Placed { node: root, parent: None, world_from_node: Matrix4::identity() });
    }
    while let Some(mut next) = open.pop() {
        let node = document.nodes.get(next.node).ok_or_else(|| missing("node", next.node))?;
        if std::mem::replace(&mut seen[next.node], true) {
            return Err(format!("node {} hangs in the node tree twice; export the file again", next.node));
        }
        next.world_from_node *= local_matrix(node);
        for &child in node.children.iter().rev() {
            open.push(Placed {
                node: child,
                parent: Some(placed.len()),
                world_from_node: next.world_from_node,
            });
        }
        placed.push(next);
    }
    Ok(placed)
}

fn roots(document: &Document) -> Checked<Vec<usize>> {
    let index = document.scene.unwrap_or(0);
    match document.scenes.get(index) {
        Some(scene) => Ok(scene.nodes.clone()),
        None if document.scenes.is_empty() => {
            let mut is_root = vec![true; document.nodes.len()];
            for &child in document.nodes.iter().flat_map(|node| &node.children) {
                *is_root.get_mut(child).ok_or_else(|| missing("node", child))? = false;
            }
            Ok((0..is_root.len()).filter(|&node| is_root[node]).collect())
        }
        None => Err(missing("scene", index)),
    }
}

fn local_matrix(node: &Node) -> Matrix4<f64> {
    if let Some(columns) = &node.matrix {
        return Matrix4::from_column_slice(columns);
    }
    let mut matrix = Matrix4::new_nonuniform_scaling(&Vector3::from(node.scale.unwrap_or([1.0; 3])));
    if let Some([x, y, z, w]) = node.rotation {
        matrix = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)).to_homogeneous() * matrix;
    }
    matrix.append_translation(&Vector3::from(node.translation.unwrap_or_default()))
}
