use crate::{Store, StoreError, words::to_json};
use serde::{Deserialize, Serialize};

/// A set of missions.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Split {
    /// Its name.
    pub name: String,
    /// Hash of all of its episodes.
    pub digest: String,
    /// Scenes that occur in it.
    pub scenes: u32,
    /// Episodes in it.
    pub episodes: u32,
}

/// A building, as far as pages show it.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Its name.
    pub name: String,
    /// Hash of its content.
    pub digest: String,
    /// Its floor plan.
    pub map: SceneMap,
}

/// A floor plan in the world frame (Y up), metres.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SceneMap {
    /// Smallest corner of the building: x, y, z.
    pub min: [f32; 3],
    /// Largest corner of the building: x, y, z.
    pub max: [f32; 3],
    /// Walkable polygons, each a closed ring of x, y, z.
    pub polygons: Vec<Vec<[f32; 3]>>,
}

impl Store {
    /// Adds a split; adding the same one again changes nothing.
    ///
    /// # Errors
    /// When the name is taken by a split with another digest, or the database fails.
    pub async fn upsert_split(&self, split: &Split) -> Result<(), StoreError> {
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
        same_digest("split", &split.name, &stored, &split.digest)
    }

    /// Names of all splits.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn split_names(&self) -> Result<Vec<String>, StoreError> {
        Ok(sqlx::query_scalar("SELECT name FROM splits ORDER BY name").fetch_all(&self.read).await?)
    }

    /// Digest of a split; `None` where there is none of that name.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn split_digest(&self, name: &str) -> Result<Option<String>, StoreError> {
        let select = "SELECT digest FROM splits WHERE name = $1";
        Ok(sqlx::query_scalar(select).bind(name).fetch_optional(&self.read).await?)
    }

    /// Adds a scene, or gives the same scene a new map; a map without polygons leaves the one that is there.
    ///
    /// # Errors
    /// When the name is taken by a scene with another digest, or the database fails.
    pub async fn upsert_scene(&self, scene: &Scene) -> Result<(), StoreError> {
        let mut tx = self.begin().await?;
        let select = "SELECT digest FROM scenes WHERE name = $1";
        let stored: Option<String> =
            sqlx::query_scalar(select).bind(&scene.name).fetch_optional(&mut *tx).await?;
        if let Some(stored) = stored {
            same_digest("scene", &scene.name, &stored, &scene.digest)?;
        }
        let upsert = "INSERT INTO scenes (name, digest, map) VALUES ($1, $2, $3) \
                      ON CONFLICT (name) DO UPDATE SET map = excluded.map WHERE $4";
        let map = to_json("map", &scene.map)?;
        let drawn = !scene.map.polygons.is_empty();
        let insert = sqlx::query(upsert).bind(&scene.name).bind(&scene.digest).bind(map).bind(drawn);
        insert.execute(&mut *tx).await?;
        Ok(tx.commit().await?)
    }
}

fn same_digest(what: &'static str, name: &str, stored: &str, given: &str) -> Result<(), StoreError> {
    if stored == given { Ok(()) } else { Err(StoreError::Taken { what, name: name.to_owned() }) }
}
