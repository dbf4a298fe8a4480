//! Splits and scenes in the database.

use crate::{
    database::Store,
    error::{Result, StoreError},
};
use serde::{Deserialize, Serialize};
use sqlx::types::Json;

/// A set of missions.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Split {
    /// Split name.
    pub name: String,
    /// Hash over all episodes.
    pub digest: String,
    /// Scene count.
    pub scenes: u32,
    /// Episode count.
    pub episodes: u32,
}

/// A scene's public part.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Scene name.
    pub name: String,
    /// Content hash.
    pub digest: String,
    /// Floor plan.
    pub map: SceneMap,
}

/// A floor plan in the world frame (Y up), metres.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct SceneMap {
    /// Building minimum corner: x, y, z.
    pub min: [f32; 3],
    /// Building maximum corner: x, y, z.
    pub max: [f32; 3],
    /// Walkable polygons, each a closed ring of x, y, z.
    pub polygons: Vec<Vec<[f32; 3]>>,
}

impl Store {
    /// Adds a split. A repeated call has no effect. Fails if a split with this name has another digest.
    pub async fn upsert_split(&self, split: &Split) -> Result<()> {
        let insert = "INSERT INTO splits (name, digest, scenes, episodes) VALUES ($1, $2, $3, $4) ON CONFLICT DO NOTHING";
        sqlx::query(insert)
            .bind(&split.name)
            .bind(&split.digest)
            .bind(split.scenes)
            .bind(split.episodes)
            .execute(&self.write)
            .await?;
        let select = "SELECT digest FROM splits WHERE name = $1";
        let stored: String = sqlx::query_scalar(select).bind(&split.name).fetch_one(&self.read).await?;
        check_digest("split", &split.name, &stored, &split.digest)
    }

    /// Returns all split names.
    pub async fn split_names(&self) -> Result<Vec<String>> {
        Ok(sqlx::query_scalar("SELECT name FROM splits ORDER BY name").fetch_all(&self.read).await?)
    }

    /// Returns a split's digest; `None` if there is no split with this name.
    pub async fn split_digest(&self, name: &str) -> Result<Option<String>> {
        let select = "SELECT digest FROM splits WHERE name = $1";
        Ok(sqlx::query_scalar(select).bind(name).fetch_optional(&self.read).await?)
    }

    /// Adds a scene or replaces the map, never by one without polygons. Fails if a scene with this name has another digest.
    pub async fn upsert_scene(&self, scene: &Scene) -> Result<()> {
        let mut tx = self.begin().await?;
        let select = "SELECT digest FROM scenes WHERE name = $1";
        let stored: Option<String> =
            sqlx::query_scalar(select).bind(&scene.name).fetch_optional(&mut *tx).await?;
        if let Some(stored) = stored {
            check_digest("scene", &scene.name, &stored, &scene.digest)?;
        }
        let upsert = "INSERT INTO scenes (name, digest, map) VALUES ($1, $2, $3) \
                      ON CONFLICT (name) DO UPDATE SET map = excluded.map WHERE $4";
        sqlx::query(upsert)
            .bind(&scene.name)
            .bind(&scene.digest)
            .bind(Json(&scene.map))
            .bind(!scene.map.polygons.is_empty())
            .execute(&mut *tx)
            .await?;
        Ok(tx.commit().await?)
    }
}

fn check_digest(what: &'static str, name: &str, stored: &str, given: &str) -> Result<()> {
    if stored == given { Ok(()) } else { Err(StoreError::Taken { what, name: name.to_owned() }) }
}
