// How Unity imports $NAME.fbx; written by Latent Motion.
using System.Linq;
using UnityEditor;
using UnityEngine;

class $CLASS : AssetPostprocessor
{
    class Known
    {
        public string name;
        public bool loops;
        public float[] times;
        public string[] what;
    }

    static readonly Known[] Clips =
    {
$CLIPS
    };

    bool Ours => assetPath.EndsWith("/" + $FILE);

    void OnPreprocessModel()
    {
        if (!Ours) return;
        var model = (ModelImporter)assetImporter;
        model.animationType = ModelImporterAnimationType.Generic;
        model.avatarSetup = ModelImporterAvatarSetup.CreateFromThisModel;
    }

    void OnPreprocessAnimation()
    {
        if (!Ours) return;
        var model = (ModelImporter)assetImporter;
        model.motionNodeName = model.transformPaths.FirstOrDefault(
            path => path == $ROOT || path.EndsWith("/" + $ROOT)) ?? "";
        var clips = model.defaultClipAnimations;
        foreach (var clip in clips)
        {
            var take = clip.takeName.Substring(clip.takeName.LastIndexOf('|') + 1);
            var known = Clips.FirstOrDefault(one => one.name == take);
            if (known == null) continue;
            clip.name = take;
            clip.loopTime = known.loops;
            clip.events = known.times.Select((time, n) => new AnimationEvent
            {
                time = time,
                functionName = "OnFoot",
                stringParameter = known.what[n],
                messageOptions = SendMessageOptions.DontRequireReceiver,
            }).ToArray();
        }
        model.clipAnimations = clips;
    }
}
